/* Paths of pixels of the bidirectional pass (worker/pass/bidirectional.h): thread x follows one sample of pixel
 * `index` + x, connects it to the vertices of its path of light, merges photons with it, connects the vertices of the
 * path of light to the camera, and adds what that brings. Ways, random numbers and estimators are those of
 * worker/backend/embree/bidirectional_eye.c and bidirectional_light.c.
 *
 * A thread goes through jobs, one a round. The code that traces, that makes a vertex, that scatters and that weighs a
 * light is long, and stands once: a round asks for what its job needs of it. */
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/sum.glsl"

KILN_PUSH(kiln_gpu_both_push);

layout(constant_id = 6) const uint METHOD = 15u; /* KILN_GPU_BOTH_...: what the method does */
const bool SPLATS = (METHOD & KILN_GPU_BOTH_SPLATS) != 0u, CONNECTS = (METHOD & KILN_GPU_BOTH_CONNECTS) != 0u,
           MERGES = (METHOD & KILN_GPU_BOTH_MERGES) != 0u, OWN = (METHOD & KILN_GPU_BOTH_OWN) != 0u;

#include "shaders/bidirectional.glsl"

KILN_ARRAY(PathSums, kiln_gpu_path_sums, 4);
KILN_ARRAY(Photons, kiln_gpu_photon, 4);

/* A vertex of light is connected to the camera: what it would bring, whether it is seen. The camera's ray arrives. Of
 * the vertex that it has come to: samples of the light tree, of directional lights, of the environment; connections, of
 * which first the near end scatters, then the far; merging; the way on. */
const uint SPLAT = 0u, SEE = 1u, ARRIVE = 2u, TREE = 3u, SUN = 4u, SKY = 5u, NEAR = 6u, FAR = 7u, MERGE = 8u,
           GO_ON = 9u, END = 10u;
uint job;

/* The camera's path under way. */
uint64_t pixel;
Vertex here; /* where it is; before it begins, the vertex of light that is connected to the camera */
vec3 origin, direction, weight, radiance;
kiln_path_sums sums;
uint surface, bounces, chain, rays;
bool last_diffuse;          /* the last event was: it is none of the bounces where a light comes next */
vec3 before, before_normal; /* the vertex before, and its light_normal */
Way way;                    /* on from here */
bool good;                  /* the device has ended no loop early */

/* The vertex of light under way, as it was kept; as the far end of a connection; and what is left of its path. */
kiln_gpu_light_vertex kept;
Vertex there;
uint next;
Scatter near_scatter;

/* Merging: photons photon .. photon_end - 1 are left of a bucket, whose cell is the one before `cell` of the eight from
 * `low` on. */
uint cell, photon, photon_end;
ivec3 low;
i64vec3 merged; /* in units of the film's times `area` */
kiln_gpu_photon found;

/* What the round asks for. */
bool wants_trace, wants_vertex, wants_scatter, wants_light, wants_through;
vec3 from_, towards; /* the ray, */
float limit;
vec3 o_, i_; /* the directions, */
uint which;
uint light; /* the light whose densities are wanted, seen from a place with a normal; its own place and direction */
real3 light_seen_from, light_seen_about, light_place, light_direction;
real light_cosine;
/* and what it gets. */
kiln_hit hit;
vec3 tint, through;
bool sends;
Scatter s;
real connect, emission;

uint sun; /* the next directional light */
kiln_light_sample drawn;
vec3 brings; /* what comes, if nothing is in the way */

/* ---- the camera ---- */

struct View { /* struct subpath_view */
    uint64_t pixel;
    vec3 origin, towards;
    float distance;
};
View view;

/* From the lens' middle to a place on it. */
vec3 lens_place(uvec2 numbers)
{
    return kiln_path_lens(BOTH.right, BOTH.up, BOTH.lens_radius, float(real_unit(numbers.x)),
                          float(real_unit(numbers.y)));
}

/* The place in the picture, from -1 to 1 both ways, at which a ray from `eye` to the place is seen. */
bool picture_place(vec3 eye, vec3 place, out real x, out real y)
{
    const real3 right = real3(BOTH.right), up = real3(BOTH.up);
    real3 to = real3(place - eye);
    const real depth = dot(to, real3(BOTH.forward));
    real over = BOTH.orthographic != 0u ? real(1) : depth;
    if (BOTH.lens_radius > 0.0) { /* by where the ray crosses the plane in focus, seen from the lens' middle */
        over = real(BOTH.focus_distance);
        to = to * (over / depth) + real3(eye - BOTH.position);
    }
    x = dot(to, right) / (dot(right, right) * over);
    y = dot(to, up) / (dot(up, up) * over);
    return depth > 0;
}

/* Of the vertex of light under way. */
bool view_of(vec3 place)
{
    real x, y;
    view.origin = BOTH.position;
    if (BOTH.lens_radius > 0.0) {
        uint u, v;
        kiln_path_numbers(kiln_path_key(push.light_key, kiln_path_use(kept.number, KILN_LENS_USE)), uint(pixel), u, v);
        view.origin += lens_place(uvec2(u, v));
    }
    if (!picture_place(view.origin, place, x, y))
        return false;
    const real column = floor(KILN_RATIO(1, 2) * (x + 1) * real(BOTH.width)),
               row = floor(KILN_RATIO(1, 2) * (1 - y) * real(BOTH.height));
    if (!(column >= 0) || !(row >= 0) || !(column < real(BOTH.width)) || !(row < real(BOTH.height)))
        return false;
    view.pixel = uint64_t(uint(row)) * BOTH.width + uint(column);
    if (BOTH.orthographic != 0u)
        view.origin += BOTH.right * float(x) + BOTH.up * float(y);
    const vec3 back = view.origin - place;
    view.distance = length(back);
    view.towards = back / view.distance;
    return view.distance > 0.0;
}

/* Of the camera's rays, per m2, at a place with this cosine. */
real camera_density(vec3 to_camera, float distance, float cosine)
{
    if (BOTH.orthographic != 0u)
        return real(cosine) / real(BOTH.pixel);
    const real ahead = -real(dot(to_camera, BOTH.forward)), far = real(distance);
    return real(cosine) / (real(BOTH.pixel) * ahead * ahead * ahead * far * far);
}

void camera_ray()
{
    const uvec2 place = walk_draw(0u);
    const uint row = uint(pixel / BOTH.width), column = uint(pixel - uint64_t(row) * BOTH.width);
    const real x = (real(column) + real_unit(place.x)) / real(BOTH.width) * 2 - 1,
               y = 1 - (real(row) + real_unit(place.y)) / real(BOTH.height) * 2;
    const vec3 aside = BOTH.right * float(x) + BOTH.up * float(y);
    const bool parallel = BOTH.orthographic != 0u;
    origin = parallel ? BOTH.position + aside : BOTH.position;
    direction = normalize(parallel ? BOTH.forward : BOTH.forward + aside);
    if (BOTH.lens_radius > 0.0) {
        const vec3 start = lens_place(walk_draw(KILN_PATH_LENS));
        origin += start;
        direction = normalize((BOTH.forward + aside) * BOTH.focus_distance - start);
    }
}

bool is_seen(kiln_hit at) { return (triangle_at(at.triangle).flags & KILN_GPU_PATH_HIDDEN) == 0u && has_side(at); }

/* The nearest surface up to `limit`; `looks`: of those that the camera sees. */
void trace(uint chance, bool looks)
{
    tint = vec3(1.0);
    for (uint k = 0u; k <= KILN_PATH_UNSEEN; k++) {
        vec3 part;
        hit = kiln_trace_within(from_, towards, limit, chance, part);
        tint *= part;
        if (hit.triangle == KILN_GPU_NONE || !looks || is_seen(hit))
            return;
        const float beyond = kiln_path_beyond(hit.distance, BOTH.extent);
        from_ += towards * beyond;
        limit -= beyond;
    }
    hit.triangle = KILN_GPU_NONE;
}

/* ---- sums ---- */

/* Whole units of what comes; false: more than the sums hold. */
bool units_of(vec3 rgb, real unit, out i64vec3 units)
{
    const real3 count = roundEven(real3(rgb) / unit);
    units = i64vec3(0l);
    const bool holds = count.x < real(9007199254740992.0LF) && count.y < real(9007199254740992.0LF) &&
                       count.z < real(9007199254740992.0LF); /* 2^53 */
    if (holds)
        units = i64vec3(count);
    else
        BothCounts(BOTH.counts).at[0].too_much = 1u;
    return holds;
}

/* Adds to a pixel of the film: numbers of 64 bits in two halves, whose carries make them exact in any order. */
void add_to_film(uint64_t to, vec3 rgb)
{
    i64vec3 units;
    if (!units_of(rgb, real(BOTH.unit), units))
        return;
    BothWords film = BothWords(BOTH.film + 24ul * to);
    for (uint c = 0u; c < 3u; c++) {
        const uint lower = uint(units[c]), upper = uint(uint64_t(units[c]) >> 32);
        if (units[c] == 0l)
            continue;
        const uint old = lower != 0u ? atomicAdd(film.at[2u * c], lower) : 0u;
        const uint carried = upper + (old + lower < old ? 1u : 0u);
        if (carried != 0u)
            atomicAdd(film.at[2u * c + 1u], carried);
    }
}

void add(vec3 by, vec3 rgb, real factor) { radiance += by * rgb * float(factor); }

/* ---- what a job asks for ---- */

/* The next vertex of the path of light; false: none is left. */
bool next_kept()
{
    if (next == KILN_GPU_NONE)
        return false;
    kept = LightVertices(BOTH.vertices + 72ul * next).at[0];
    next = kept.previous;
    return true;
}

void begin_kept() { next = BothWords(BOTH.last).at[uint(pixel) - push.path]; }

void ask_scatter(vec3 to_eye, vec3 to_light, uint lobes_)
{
    wants_scatter = true;
    o_ = to_eye;
    i_ = to_light;
    which = lobes_;
}

void ask_light(uint number, real3 p, real3 n, real3 place, real3 direction_, real cosine)
{
    wants_light = true;
    light = number;
    light_seen_from = p;
    light_seen_about = n;
    light_place = place;
    light_direction = direction_;
    light_cosine = cosine;
}

void ask_splat()
{
    if (!next_kept()) {
        job = ARRIVE;
        camera_ray();
    } else if (view_of(kept.position)) {
        wants_vertex = true;
    }
}

void ask_see()
{
    const vec3 d = vertex_start(here, view.towards) - view.origin;
    const float distance = length(d);
    rays++;
    wants_trace = true;
    from_ = view.origin;
    towards = d / distance;
    limit = float(real(distance) * KILN_SHADOW_LENGTH);
}

void ask_arrive()
{
    rays++;
    wants_trace = true;
    from_ = origin;
    towards = direction;
    limit = KILN_INFINITY;
}

void ask_sample(uint number)
{
    const bool far = isinf(drawn.distance), area = number < SCENE.lights.area_count;
    const real3 p = real3(here.m.position);
    const real cosine =
        area ? abs(dot(real3_of(AreaLights(SCENE.lights.areas).at[number].normal), drawn.direction)) : real(1);
    ask_light(number, p, real3(light_normal(here)), far ? p : p + drawn.direction * drawn.distance, -drawn.direction,
              cosine);
    ask_scatter(here.from, vec3(drawn.direction), KILN_LOBE_ALL);
}

void ask_sky()
{
    const uvec2 place = walk_draw(kiln_path_use(surface, KILN_PATH_SKY));
    real density;
    drawn.direction = kiln_environment_sample(real_unit(place.x), real_unit(place.y), density);
    drawn.distance = real(KILN_INFINITY);
    drawn.backoff = 0;
    drawn.has_extent = true;
    drawn.value = real3(kiln_environment_radiance(drawn.direction)) / density;
    if (density > 0)
        ask_sample(emission_environment());
}

void ask_lamp()
{
    const uvec2 place = walk_draw(kiln_path_use(surface, KILN_PATH_LIGHT)),
                pick = walk_draw(kiln_path_use(surface, KILN_PATH_PICK));
    const real3 n = real3(light_normal(here));
    const bool is_sun = job == SUN;
    const kiln_light_choice choice =
        kiln_light_choice(is_sun ? KILN_CHOICE_DIRECTIONAL : KILN_CHOICE_NODE, is_sun ? sun : 0u, 1u);
    if (kiln_lights_sample(choice, 0u, real3(here.m.position), n, n, real_unit(pick.x), real_unit(place.x),
                           real_unit(place.y), drawn))
        ask_sample(is_sun ? emission_directional(sun) : drawn.light);
}

int allowed(uint other) { return int(BOTH.most) - int(here.bounces) - int(other); }

/* Whether the vertex of light may be connected to this one; where this one is diffuse, only if it faces there. */
bool may_connect()
{
    const vec3 d = kept.position - here.m.position;
    return dot(d, d) > 0.0 && allowed(kept.bounces) >= 0 &&
           kiln_path_allows(BOTH.path_length, surface + kept.number + 3u) &&
           (here.m.gloss || dot(here.m.normal, normalize(d)) > 0.0);
}

/* The next one that may be; false: none is left. What stays dark costs no round of its own. */
bool next_facing()
{
    bool faces = false;
    while (!faces && next_kept())
        faces = may_connect();
    return faces;
}

bool near_enough(vec3 place)
{
    const vec3 d = place - here.m.position;
    return dot(d, d) <= float(real(BOTH.radius) * real(BOTH.radius));
}

/* The next photon of the pixel's own within the radius. */
bool next_own()
{
    while (next_kept())
        if (near_enough(kept.position)) {
            found = kiln_gpu_photon(kept.position, kept.from, kept.flux, kept.vcm, kept.vm, kept.bounces, kept.number);
            return true;
        }
    return false;
}

/* Of the eight cells in which the photons near a place are. */
ivec3 corner_of(uint number) { return ivec3(number & 1u, number >> 1u & 1u, number >> 2u); }

/* The next one of all; false: none is left. */
bool next_photon()
{
    while (photon < photon_end || cell < 8u) {
        if (photon == photon_end) {
            const uint bucket = photon_bucket(low + corner_of(cell));
            photon = BothWords(BOTH.begins).at[bucket];
            photon_end = BothWords(BOTH.ends).at[bucket];
            cell++;
        } else {
            const uint k = cell - 1u;
            Photons at = Photons(BOTH.photons + 52ul * photon);
            photon++;
            /* buckets are shared by cells, and two of the eight may have one */
            const vec3 place = at.at[0].position;
            const bool is_found = near_enough(place) && photon_cell(place, 0) == low + corner_of(k);
            if (is_found) {
                found = at.at[0];
                return true;
            }
        }
    }
    return false;
}

void begin_merging()
{
    merged = i64vec3(0l);
    cell = 0u;
    photon = 0u;
    photon_end = 0u;
    if (OWN)
        begin_kept();
    else
        low = photon_cell(here.m.position, KILN_RATIO(-1, 2));
}

void end_merging()
{
    /* both subpaths have met the surface by chance */
    add(here.weight, vec3(real3(merged) * real(BOTH.unit)), 1 / real(here.opacity));
    job = GO_ON;
}

void ask_go_on()
{
    const uint lobes_ = CONNECTS ? KILN_LOBE_ALL : here.mirrors;
    if (lobes_ == 0u || !way_draw(here, false, lobes_, surface, way) || (!CONNECTS && !way.delta)) {
        job = END;
        return;
    }
    which = lobes_;
    if (!way.delta)
        ask_scatter(here.from, way.direction, lobes_);
}

/* Jobs that have nothing left to ask give way to the next. */
void ask()
{
    wants_trace = false;
    wants_vertex = false;
    wants_scatter = false;
    wants_light = false;
    wants_through = false;
    if (SPLATS && job == SPLAT)
        ask_splat();
    else if (SPLATS && job == SEE)
        ask_see();
    else if (job == ARRIVE)
        ask_arrive();
    else if (CONNECTS && (job == TREE || job == SUN))
        ask_lamp();
    else if (CONNECTS && job == SKY)
        ask_sky();
    else if (CONNECTS && job == NEAR) {
        if (next_facing())
            ask_scatter(here.from, normalize(kept.position - here.m.position), KILN_LOBE_ALL);
        else {
            job = MERGES ? MERGE : GO_ON;
            if (MERGES)
                begin_merging();
        }
    } else if (CONNECTS && job == FAR)
        wants_vertex = true;
    else if (MERGES && job == MERGE) {
        const bool any = OWN ? next_own() : next_photon();
        if (!any)
            end_merging();
        else if (kiln_path_allows(BOTH.path_length, surface + found.number + 2u))
            ask_scatter(here.from, found.from, CONNECTS ? KILN_LOBE_ALL : KILN_LOBE_ALL & ~here.mirrors);
    } else
        ask_go_on();
}

/* ---- the camera's ray arrives ---- */

/* Whether a light may come next on the path. */
bool may_meet()
{
    return (surface == 0u || CONNECTS || MERGES) && int(bounces) - (last_diffuse ? 1 : 0) <= int(BOTH.most);
}

void meet_environment()
{
    brings = may_meet() ? weight * kiln_environment_radiance(real3(direction)) : vec3(0.0);
    if (surface > 0u && CONNECTS && SCENE.lights.environment != 0u && shines(brings))
        ask_light(emission_environment(), real3(before), real3(before_normal), -real3(direction), -real3(direction), 1);
}

void meet_emitter()
{
    brings = vec3(0.0);
    if ((material_of(hit.triangle) & KILN_RECORD_EMITS) == 0u || !may_meet())
        return;
    brings = here.weight * kiln_surface_emission(hit.triangle, hit.u, hit.v);
    const uint number = surface > 0u && CONNECTS ? emission_of_triangle(hit.triangle) : KILN_GPU_NONE;
    if (number == KILN_GPU_NONE ||
        (hit.back && (AreaLights(SCENE.lights.areas).at[number].flags & KILN_GPU_LIGHT_TWO_SIDED) == 0u))
        return;
    ask_light(number, real3(before), real3(before_normal), real3(here.m.position), real3(here.from),
              real(abs(dot(here.m.normal, here.from))));
}

/* What the ray has met, before its vertex is made; false: there is none. */
bool arrives()
{
    weight *= tint;
    if (hit.triangle == KILN_GPU_NONE)
        meet_environment();
    else if (surface == 0u || has_side(hit))
        return true;
    else
        brings = vec3(0.0);
    return false;
}

/* The vertex that the ray has come to; false: the path ends. */
bool settle()
{
    const float cosine = abs(dot(here.m.normal, here.from));
    brings = vec3(0.0);
    if (!(cosine > 0.0))
        return false;
    here.weight = weight;
#ifdef KILN_GLOSS
    here.weight *= attenuation(hit);
#endif
    here.bounces = bounces;
    if (surface == 0u) {
        const real density = camera_density(here.from, length(here.m.position - origin), cosine);
        here.sums = kiln_path_sums(real(BOTH.paths) / density, 0, 0);
    } else {
        const vec3 d = here.m.position - before;
        here.sums = sums;
        kiln_path_arrive(here.sums, real(dot(d, d)), real(cosine));
    }
    meet_emitter();
    return true;
}

/* The first job at a vertex of the camera's path. */
void begin_vertex()
{
    job = GO_ON;
    if (here.bounces > BOTH.most || !(CONNECTS || MERGES) || !kiln_path_allows(BOTH.path_length, surface + 2u)) {
        job = END;
    } else if (CONNECTS && !here.is_delta) {
        job = TREE;
        sun = 0u;
    } else if (MERGES && !here.is_delta) {
        job = MERGE;
        begin_merging();
    }
}

/* ---- what a round has found ---- */

/* The vertex of light that was asked for: the far end of a connection, or what the camera may see. */
void use_light()
{
    if (job == FAR) {
        ask_scatter(normalize(here.m.position - there.m.position), there.from, KILN_LOBE_ALL);
        return;
    }
    hit.back = dot(here.front, view.towards) < 0.0;
    if (is_seen(hit))
        ask_scatter(view.towards, here.from, KILN_LOBE_ALL);
}

void take_splat()
{
    if (!sends)
        return;
    const vec3 product =
        scatter_product(s, kept.number > 0u, vec3(1.0), vec3(0.0), int(BOTH.most) - int(here.bounces));
    const real density = camera_density(view.towards, view.distance, s.cosine_o) / real(BOTH.paths);
    const real share =
        CONNECTS ? kiln_path_weight_seen(path_techniques(), here.sums, density, real(s.to_light)) : real(1);
    brings = product * here.weight * vertex_attenuation(here, view.towards, view.distance) * float(density * share);
    if (shines(product))
        job = SEE;
}

void take_arrival()
{
    real share = 1;
    if (wants_light)
        share = kiln_path_weight_met(wants_vertex ? here.sums : sums, connect, emission);
    radiance += brings * float(share);
}

/* Which way the shadow ray of a sample or a connection goes. */
void ask_through()
{
    if (!sends || (job != FAR && !(connect > 0)))
        return;
    wants_through = true;
    rays++;
    from_ = vertex_start(here, job == FAR ? -o_ : i_);
    if (job == FAR) {
        const vec3 d = vertex_start(there, o_) - from_;
        const float distance = length(d);
        towards = d / distance;
        limit = float(real(distance) * KILN_SHADOW_LENGTH);
    } else {
        towards = kiln_shadow_ray(drawn, real3(from_ - here.m.position), limit);
    }
}

void weigh_sample()
{
    const real squared = isinf(drawn.distance) ? real(1) : drawn.distance * drawn.distance;
    const real met = drawn.has_extent ? real(s.to_light) * light_cosine / squared : real(0);
    const real share = kiln_path_weight_sampled(path_techniques(), here.sums, connect, emission,
                                                real(s.cosine_i) / squared, met, real(s.to_eye));
    brings = vec3(drawn.value * share) * s.all * s.cosine_i;
}

void weigh_connection()
{
    const vec3 d = there.m.position - here.m.position;
    const float squared = dot(d, d);
    const vec3 product =
        scatter_product(near_scatter, true, s.all, kept.number > 0u ? s.diffuse : vec3(0.0), allowed(there.bounces));
    const real share = kiln_path_weight_connected(
        path_techniques(), here.sums, there.sums, real(near_scatter.to_light * s.cosine_o / squared), real(s.to_light),
        real(s.to_eye * near_scatter.cosine_i / squared), real(near_scatter.to_eye));
    brings = product * there.weight * vertex_attenuation(there, o_, sqrt(squared)) *
             float(real(near_scatter.cosine_i * s.cosine_o / squared) * share);
    sends = shines(product);
}

void take_photon()
{
    if (!sends)
        return;
    const vec3 product = scatter_product(s, found.number > 0u, vec3(1.0), vec3(0.0), allowed(found.bounces));
    const kiln_path_sums of_light = kiln_path_sums(real(found.vcm), real(0), real(found.vm));
    const real share =
        CONNECTS ? kiln_path_weight_merged(path_techniques(), here.sums, of_light, real(s.to_light), real(s.to_eye))
                 : real(1);
    i64vec3 units;
    if (units_of(product * vec3(found.flux[0], found.flux[1], found.flux[2]) * float(share),
                 real(BOTH.unit) * real(BOTH.area), units))
        merged += units;
}

void take_way()
{
    bool goes = false;
#ifdef KILN_GLOSS
    if (way.delta)
        goes = way_mirrors(here, false, which, way);
#endif
    if (!way.delta)
        goes = sends && way_scatters(here, false, s, way);
    job = END;
    if (!goes)
        return;
    weight = here.weight * way.factor;
    origin = vertex_start(here, way.direction);
    direction = way.direction;
    sums = here.sums;
    kiln_path_leave(path_techniques(), sums, real(way.cosine), real(way.forward), real(way.backward), way.delta);
    bounces = here.bounces + (way.diffuse ? 1u : 0u);
    last_diffuse = way.diffuse;
    chain = way.diffuse ? 0u : chain + 1u;
    before = here.m.position;
    before_normal = light_normal(here);
    if (shines(weight) && path_survives(surface, chain, weight, weight)) {
        surface++;
        job = ARRIVE;
    }
}

/* After a sample of lights. */
void next_light()
{
    if (job == SUN)
        sun++;
    if (job != SKY)
        job = light_kind(KILN_GPU_KIND_SUN) && sun < SCENE.lights.directional_count ? SUN : SKY;
    else {
        job = NEAR;
        begin_kept();
    }
    if (job == SKY && SCENE.lights.environment == 0u) {
        job = NEAR;
        begin_kept();
    }
}

void take(uint asked)
{
    if (asked == SPLAT) {
        take_splat();
    } else if (asked == SEE) {
        job = SPLAT;
        if (hit.triangle == KILN_GPU_NONE)
            add_to_film(view.pixel, brings * tint);
    } else if (asked == ARRIVE) {
        take_arrival();
        if (wants_vertex)
            begin_vertex();
        else
            job = END;
    } else if (asked == TREE || asked == SUN || asked == SKY) {
        if (wants_through)
            add(here.weight, brings * through, 1);
        next_light();
    } else if (asked == NEAR) {
        if (sends) {
            near_scatter = s;
            job = FAR;
        }
    } else if (asked == FAR) {
        if (wants_through)
            add(here.weight, brings * through, 1);
        job = NEAR;
    } else if (asked == MERGE) {
        take_photon();
    } else
        take_way();
}

/* ---- a round ---- */

/* The hit and the direction of the vertex that is wanted. */
void find_vertex()
{
    const bool arrival = job == ARRIVE, far = CONNECTS && job == FAR;
    if (!arrival) {
        hit.triangle = kept.triangle & ~KILN_GPU_BOTH_BACK;
        hit.back = (kept.triangle & KILN_GPU_BOTH_BACK) != 0u;
        hit.u = kept.u;
        hit.v = kept.v;
        hit.distance = 0.0;
    }
    Vertex v = vertex_make(hit, arrival ? direction : -kept.from, arrival ? surface == 0u : job == SPLAT);
    if (!arrival) {
        v.weight = vec3(kept.flux[0], kept.flux[1], kept.flux[2]);
        v.sums = kiln_path_sums(real(kept.vcm), real(kept.vc), real(kept.vm));
        v.bounces = kept.bounces;
    }
    if (far)
        there = v;
    else
        here = v;
}

/* So that what scatters is always in one place: a copy for each photon would cost. */
void change_places()
{
    const Vertex was_here = here;
    here = there;
    there = was_here;
}

void round_()
{
    const uint asked = job;
    ask();
    if (job != asked) /* it had nothing left to ask */
        return;
    if (wants_trace) {
        const uint key = push.light_key, of_light = path_chance(key, uint(pixel), kept.number);
        trace(asked == SEE ? ~of_light : path_chance(walk_key, walk_sample, surface), asked == SEE || surface == 0u);
    }
    if (asked == ARRIVE)
        wants_vertex = arrives();
    if (wants_vertex) {
        find_vertex();
        if (asked != ARRIVE)
            use_light();
        else if (!settle())
            wants_vertex = false;
    }
    sends = false;
    if (wants_scatter) {
        const bool far = CONNECTS && asked == FAR;
        if (far)
            change_places();
        sends = vertex_scatter(here, o_, i_, which, s);
        if (far)
            change_places();
    }
    if (CONNECTS && wants_light) {
        connect = emission_connect(light, light_seen_from, light_seen_about, light_place, light_direction);
        emission = emission_density(light, light_cosine, light_direction);
    }
    if (CONNECTS && wants_scatter && (asked == TREE || asked == SUN || asked == SKY || asked == FAR)) {
        if (asked == FAR && sends)
            weigh_connection();
        ask_through();
        if (wants_through && asked != FAR)
            weigh_sample();
    }
    if (CONNECTS && wants_through)
        through = kiln_through(from_, towards, limit);
    take(asked);
}

/* Jobs in turn: those from one of `stages` up to the next go round together. Threads that run in step thus have one job
 * each time: those that are done with theirs wait for the others, where else each would go through all that any of them
 * has to do. */
void go_through()
{
    const uint stages[6] = uint[6](SPLAT, ARRIVE, NEAR, MERGE, GO_ON, END);
    [[dont_unroll]] for (uint k = 0u; k < 5u; k++) {
        const uint first = stages[k], end = stages[k + 1u];
        [[dont_unroll]] while (job >= first && job < end)
            [[dont_unroll]] for (uint j = first; j < end; j++)
                if (job == j)
                    round_();
    }
}

void follow()
{
    weight = vec3(1.0);
    radiance = vec3(0.0);
    surface = 0u;
    bounces = 0u;
    chain = 0u;
    last_diffuse = false;
    job = SPLATS ? SPLAT : ARRIVE;
    if (SPLATS)
        begin_kept();
    else
        camera_ray();
    while (job != END)
        go_through();
    good = job == END && still_loops(push.count);
}

void kiln_kernel(uint x, uint y)
{
    if (x >= push.count || y > 0u)
        return;
    pixel = push.index + x;
    PathSums all = PathSums(push.sums + uint64_t(x) * 40ul);
    kiln_gpu_path_sums to = all.at[0];
    walk_key = kiln_hash2(kiln_hash2(push.seed, uint(pixel)), uint(pixel >> 32));
    walk_sample = push.sampled;
    rays = 0u;
    follow();
    const float luminance = float_luminance(radiance);
    const float added[4] = float[4](radiance.r, radiance.g, radiance.b, luminance * luminance);
    for (uint c = 0u; c < 4u; c++) {
        kiln_sum sum = kiln_sum(to.high[c], to.low[c]);
        kiln_add(sum, added[c]);
        to.high[c] = sum.high;
        to.low[c] = sum.low;
    }
    to.count = good && to.count != KILN_GPU_PATH_STOPPED ? to.count + 1u : KILN_GPU_PATH_STOPPED;
    to.rays += rays;
    all.at[0] = to;
}

#include "shaders/main.glsl"
