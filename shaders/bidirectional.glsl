/* Vertices of bidirectional paths: how they scatter light, and how paths from either end continue. Values, directions,
 * random numbers and estimators equal those of worker/backend/embree/bidirectional_vertex.c and its neighbours.
 *
 * Kernels include it after their push constants. A kernel should call vertex_scatter in only one place: the code of
 * scattering functions is long. */
#define KILN_TRACES
#include "shaders/trace/trace.glsl"
#include "shaders/surface.glsl"
#define KILN_WALK_LIGHTS
#include "shaders/walk.glsl"

#include "shaders/shared/bidirectional.h"

KILN_ARRAY(BothArray, kiln_gpu_both, 8);
#define BOTH BothArray(push.both).at[0]
KILN_ARRAY(BothCounts, kiln_gpu_both_counts, 4);
KILN_ARRAY(LightVertices, kiln_gpu_light_vertex, 4);
KILN_ARRAY(BothWords, uint, 4);

#include "shaders/emission.glsl"

/* ---- vertices ---- */

/* With KILN_SCATTERS_GLOSS, a kernel has no code for scattering at surfaces that are only diffuse. */
#ifdef KILN_SCATTERS_GLOSS
const bool SCATTERS_DIFFUSE = false;
#else
const bool SCATTERS_DIFFUSE = true;
#endif

struct Vertex { /* struct vertex */
    Meeting m;
    vec3 from, front, smooth_front; /* unit, to there; normals of the front */
    vec3 color;                     /* of a surface that is only diffuse */
    float opacity;
    bool is_first, is_delta;
    uint mirrors;
    vec3 weight;
    kiln_path_sums sums;
    uint bounces;
#ifdef KILN_GLOSS
    kiln_bsdf_lobes lobes;
    kiln_bsdf_choice shares;
    mat3 frame;
    vec3 o; /* `from` in the frame */
#endif
};

/* Makes the vertex of a hit; the caller sets weight, sums and bounces. */
Vertex vertex_make(kiln_hit hit, vec3 direction, bool is_first)
{
    Vertex v;
    v.m = meet(hit, direction, is_first);
    v.from = -direction;
    v.front = hit.back ? -v.m.normal : v.m.normal;
    v.smooth_front = v.front;
    v.color = vec3(0.0);
    v.opacity = 1.0;
    if (SCATTERS_DIFFUSE && HAS_ALPHA >= KILN_PASSAGE_BLEND && hit.triangle >= SCENE.opaque_count)
        v.opacity = kiln_surface_passage(hit.triangle, hit.u, hit.v).opacity;
    v.is_first = is_first;
    v.is_delta = false;
    v.mirrors = 0u;
    if (SCATTERS_DIFFUSE && !v.m.gloss)
        v.color = kiln_surface_color(hit.triangle, hit.u, hit.v, is_first);
#ifdef KILN_GLOSS
    if (v.m.gloss) {
        v.smooth_front = mesh_normal(triangle_at(hit.triangle), hit.u, hit.v);
        v.lobes = lobes;
        v.shares = shares;
        v.frame = frame;
        v.o = from;
        const bool base = lobes.base_is_mirror != 0u && lobes.p.model == KILN_BSDF_LAYERS;
        v.mirrors = (base ? KILN_LOBE_GLOSS : 0u) | (lobes.coat_is_mirror != 0u ? KILN_LOBE_COAT : 0u);
        v.is_delta = shares.diffuse == 0.0 && shares.near == 0.0 && shares.far == 0.0 &&
                     (shares.gloss == 0.0 || (v.mirrors & KILN_LOBE_GLOSS) != 0u) &&
                     (shares.coat == 0.0 || (v.mirrors & KILN_LOBE_COAT) != 0u);
    }
#endif
    return v;
}

/* A vertex of light that was kept. */
Vertex vertex_of(kiln_gpu_light_vertex l, bool is_first)
{
    kiln_hit hit;
    hit.triangle = l.triangle & ~KILN_GPU_BOTH_BACK;
    hit.back = (l.triangle & KILN_GPU_BOTH_BACK) != 0u;
    hit.u = l.u;
    hit.v = l.v;
    hit.distance = 0.0;
    Vertex v = vertex_make(hit, -l.from, is_first);
    v.weight = vec3(l.flux[0], l.flux[1], l.flux[2]);
    v.sums = kiln_path_sums(real(l.vcm), real(l.vc), real(l.vm));
    v.bounces = l.bounces;
    return v;
}

#ifdef KILN_LIFTS
/* Sets the distance `lift` by which rays start off the surface; 0: none. */
void vertex_lift(float lift, inout Vertex v)
{
    v.m.coarse = is_coarse(v.m.triangle, triangle_at(v.m.triangle), v.m.back);
    v.m.lifted = v.m.coarse && (v.is_first || v.m.gloss);
    v.m.lift = lift;
}
#endif

vec3 vertex_start(Vertex v, vec3 direction) { return meeting_start(v.m, direction); }

/* Normal of a vertex as emission_connect expects it: zero if light may come from either side. */
vec3 light_normal(Vertex v)
{
#ifdef KILN_GLOSS
    if (v.m.gloss && v.lobes.glass > 0.0)
        return vec3(0.0);
#endif
    return v.m.coarse ? vec3(0.0) : v.m.normal;
}

/* Share of light left on its way from the vertex to the eye's side, over a distance in m, in a body of glass that it
 * bounds. */
vec3 vertex_attenuation(Vertex v, vec3 direction, float distance)
{
#ifdef KILN_GLOSS
    if (v.m.gloss && (gloss_of(v.m.triangle) & KILN_GPU_GLOSS_VOLUME) != 0u && !(dot(v.front, direction) > 0.0))
        return kiln_gloss_attenuation(material_of(v.m.triangle) & KILN_RECORD_MATERIAL, distance);
#endif
    return vec3(1.0);
}

/* ---- scattering ---- */

struct Scatter { /* struct vertex_scatter */
    vec3 all, diffuse;
    float to_light, to_eye, cosine_o, cosine_i, landing_o, landing_i;
};

vec3 axis_of(Vertex v)
{
    const vec3 both = v.m.normal + v.m.shading;
    return v.is_first && both != vec3(0.0) ? normalize(both) : v.m.normal;
}

bool shines(vec3 rgb) { return max(rgb.r, max(rgb.g, rgb.b)) > 0.0; }

bool scatter_diffuse(Vertex v, vec3 o, vec3 i, inout Scatter s)
{
    const float no = dot(v.m.normal, o), ni = dot(v.m.normal, i);
    if (!(no > 0.0) || !(v.m.lifted ? s.cosine_i > 0.0 : ni > 0.0))
        return false;
    const float share = v.is_first ? max(0.0, dot(v.m.shading, i)) / s.cosine_i : 1.0;
    s.to_light = max(0.0, dot(axis_of(v), i)) * KILN_INVERSE_PI;
    s.to_eye = no * KILN_INVERSE_PI;
    s.all = v.color * (share * KILN_INVERSE_PI);
    s.diffuse = s.all;
    return shines(s.all);
}

#ifdef KILN_GLOSS
/* The normal of the scattering frame for a path that arrives from w. */
vec3 frame_axis(Vertex v, vec3 w)
{
    const bool smooth_side = dot(v.smooth_front, w) > 0.0,
               agrees = v.m.lifted ? smooth_side != v.m.back : smooth_side == (dot(v.front, w) > 0.0);
    return agrees ? v.smooth_front : v.front;
}

mat3 frame_of(Vertex v, vec3 w)
{
    const vec3 z = frame_axis(v, w);
    if (z == v.frame[2])
        return v.frame;
    const kiln_gpu_path_triangle t = triangle_at(v.m.triangle);
    return kiln_surface_frame(material_of(v.m.triangle) & KILN_RECORD_MATERIAL, v.m.triangle, v.m.u, v.m.v, z, t.e1,
                              t.e2);
}

/* Whether w is on the same side of the geometric normal and of the frame; where rays are lifted, whether it is above
 * the frame. */
bool frame_agrees(Vertex v, vec3 w, vec3 local)
{
    if (v.m.lifted)
        return v.m.back ? local.z < 0.0 : local.z > 0.0;
    return (local.z > 0.0) == (dot(v.front, w) > 0.0) && local.z != 0.0;
}

/* Evaluates the scattering for the eye, then the density of the opposite direction, in a loop so that the code exists
 * once. */
bool scatter_whole(Vertex v, vec3 o, vec3 i, uint which, inout Scatter s)
{
    if (!(s.cosine_i > 0.0))
        return false;
    for (uint part = 0u; part < 2u; part++) {
        const bool eye = part == 0u;
        const vec3 near = eye ? o : i, far = eye ? i : o;
        const mat3 f = frame_of(v, near);
        const vec3 a = near * f, b = far * f;
        if (!frame_agrees(v, far, b))
            return !eye;
        kiln_bsdf_choice c = v.shares;
        if (near != v.from)
            c = kiln_bsdf_shares(v.lobes, a);
        const kiln_bsdf_value value =
            kiln_bsdf_evaluate_chosen(v.lobes, kiln_bsdf_choice_of(c, which), a, b, KILN_RADIANCE, which);
        if (!eye) {
            s.to_eye = value.density;
            continue;
        }
        s.all = value.value / s.cosine_i;
        s.to_light = value.density;
        if (!shines(s.all))
            return false;
        if (KILN_LOBES_MAY_BE(KILN_LOBE_DIFFUSE) && v.lobes.matt > 0.0 && (which & KILN_LOBE_DIFFUSE) != 0u &&
            a.z * b.z > 0.0)
            s.diffuse = kiln_bsdf_diffuse(v.lobes, a, b) / s.cosine_i;
    }
    return true;
}
#endif

/* See struct vertex_scatter. */
float vertex_landing(Vertex v, vec3 w)
{
    const float cosine = dot(v.m.normal, w);
    return v.m.lifted ? max(0.0, cosine) : abs(cosine);
}

/* Evaluates the scattering of light from direction i to the eye in direction o. False: it is zero. */
bool vertex_scatter(Vertex v, vec3 o, vec3 i, uint which, out Scatter s)
{
    s = Scatter(vec3(0.0), vec3(0.0), 0.0, 0.0, abs(dot(v.m.normal, o)), abs(dot(v.m.normal, i)), vertex_landing(v, o),
                vertex_landing(v, i));
#ifdef KILN_GLOSS
    if (v.m.gloss)
        return scatter_whole(v, o, i, which, s);
#endif
    return SCATTERS_DIFFUSE && scatter_diffuse(v, o, i, s);
}

/* Product of the scattering at two vertices, with at most `allowed` diffuse events. The event at a counts if `counts`;
 * b_diffuse is the part of b_all that counts. */
vec3 scatter_product(Scatter a, bool counts, vec3 b_all, vec3 b_diffuse, int allowed)
{
    const vec3 a_one = counts ? a.diffuse : vec3(0.0), a_none = a.all - a_one, b_none = b_all - b_diffuse;
    vec3 product = allowed < 0 ? vec3(0.0) : a_none * b_none;
    if (allowed >= 1)
        product += a_one * b_none + a_none * b_diffuse;
    if (allowed >= 2)
        product += a_one * b_diffuse;
    return product;
}

/* ---- the way on ---- */

struct Way { /* struct vertex_way */
    vec3 direction, factor;
    float forward, backward, cosine, landing;
    bool delta, diffuse;
    float rest; /* the random number that decides whether it counts as a diffuse event */
#ifdef KILN_GLOSS
    kiln_bsdf_drawn drawn;
#endif
};

/* Draws the direction that continues the path from surface number `surface`. Call way_scatters next, unless it is a
 * mirror's (way_mirrors). False: it contributes nothing. */
bool way_draw(Vertex v, bool of_light, uint which, uint surface, out Way way)
{
    const uvec2 picks = walk_draw(kiln_path_use(surface, KILN_PATH_LOBE)),
                numbers = walk_draw(kiln_path_use(surface, KILN_PATH_BOUNCE));
    const float u = float(real_unit(numbers.x)), w = float(real_unit(numbers.y));
    way.rest = float(real_unit(picks.y));
    way.factor = vec3(0.0);
    way.forward = 0.0;
    way.backward = 0.0;
    way.cosine = 0.0;
    way.landing = 0.0;
    way.delta = false;
    way.diffuse = false;
    way.direction = vec3(0.0);
    if (SCATTERS_DIFFUSE && !v.m.gloss) {
        vec3 s, t;
        const vec3 axis = axis_of(v), local = kiln_bsdf_cosine(u, w);
        kiln_basis(axis, s, t);
        way.direction = normalize(s * local.x + t * local.y + axis * local.z);
    }
#ifdef KILN_GLOSS
    if (v.m.gloss) {
        way.drawn = kiln_bsdf_propose(v.lobes, kiln_bsdf_choice_of(v.shares, which), v.o, float(real_unit(picks.x)), u,
                                      w, of_light ? KILN_IMPORTANCE : KILN_RADIANCE);
        if (way.drawn.i.z == 0.0)
            return false;
        way.direction = normalize(v.frame * way.drawn.i);
        way.delta = way.drawn.delta;
        if (!frame_agrees(v, way.direction, way.drawn.i))
            return false;
    }
#endif
    way.cosine = abs(dot(v.m.normal, way.direction));
    way.landing = vertex_landing(v, way.direction);
    return way.cosine > 0.0;
}

#ifdef KILN_GLOSS
/* Density of the reverse direction relative to the forward one at refraction (Veach 1997, equation 5.4). */
float squeeze(Vertex v, vec3 i)
{
    if ((v.o.z > 0.0) == (i.z > 0.0) || v.lobes.p.thin_wall != 0u)
        return 1.0;
    const float eta = kiln_bsdf_eta(v.lobes.p, v.o.z > 0.0).y;
    return abs(v.o.z / i.z) / (eta * eta);
}

/* Completes a direction drawn at a mirror or smooth glass, where densities are probabilities. */
bool way_mirrors(Vertex v, bool of_light, uint which, inout Way way)
{
    if (!KILN_BSDF_MAY(KILN_BSDF_MAY_MIRROR | KILN_BSDF_MAY_COAT))
        return false;
    kiln_bsdf_drawn d = way.drawn;
    d.delta = true; /* constant, so that code for other lobes is compiled away */
    const bool same = frame_axis(v, way.direction) == v.frame[2];
    float adjoint = 1.0;
    if (of_light) {
        if (!same)
            return false;
        adjoint = kiln_shading_correction(v.o, d.i, v.front * v.frame);
    }
    way.forward = d.density;
    if (same)
        way.backward = kiln_bsdf_reverse(v.lobes, v.o, d, which) * squeeze(v, d.i);
    way.factor = d.weight * adjoint;
    return way.forward > 0.0;
}
#endif

/* Completes a drawn direction from the scattering there, at surfaces other than mirrors. False: it contributes nothing.
 */
bool way_scatters(Vertex v, bool of_light, Scatter s, inout Way way)
{
    way.forward = of_light ? s.to_eye : s.to_light;
    way.backward = of_light ? s.to_light : s.to_eye;
    if (!(way.forward > 0.0))
        return false;
    way.factor = s.all * (way.cosine / way.forward);
    const float part = float_luminance(s.diffuse), chance = part / float_luminance(s.all);
    way.diffuse = !v.m.gloss || way.rest < chance;
    if (!v.m.gloss || !(part > 0.0) || !(chance < 1.0))
        return true;
    const vec3 share = mix(vec3(0.0), min(vec3(1.0), s.diffuse / s.all), greaterThan(s.all, vec3(0.0)));
    way.factor *= way.diffuse ? share / chance : (vec3(1.0) - share) / (1.0 - chance);
    return true;
}

/* Russian roulette: whether a path continues from surface number `surface`. `share`: share of its initial weight that
 * is left; `chain`: surfaces since the last diffuse event. Divides `weight` by the probability. */
bool path_survives(uint surface, uint chain, vec3 share, inout vec3 weight)
{
    if ((BOTH.endless == 0u && chain < KILN_PATH_CHAIN) || surface < KILN_PATH_CERTAIN)
        return true;
    const float chance = kiln_path_chance(share.r, share.g, share.b);
    weight /= chance;
    return real_unit(walk_draw(kiln_path_use(surface, KILN_PATH_END)).x) < real(chance);
}

kiln_path_techniques path_techniques()
{
    const real area = real(BOTH.area);
    return kiln_path_techniques(area, area > 0 ? 1 / area : 0);
}

/* Returns the seed of the chances of a ray to surface number `surface`. */
uint path_chance(uint key, uint which, uint surface)
{
    return kiln_hash2(kiln_path_key(key, kiln_path_use(surface, KILN_PATH_CHANCE)), which);
}

/* ---- places of photons ---- */

#include "shaders/photon_cells.glsl"
