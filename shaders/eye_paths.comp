/* Camera paths of the bidirectional pass (worker/pass/bidirectional.h), in stages; thread x: the path in its slot. A
 * path begins at a random position of its pixel. At each hit it adds light of an emitter, requests shadow rays to light
 * samples, stores its vertex for connections and merging, and continues. At the end its light is added to the pixel.
 * Directions, random numbers and estimators equal those of worker/backend/embree/bidirectional_eye.c. */
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "shaders/kernel.glsl"
#include "shaders/shared/color.h"
#include "shaders/sum.glsl"

KILN_PUSH(kiln_gpu_both_push);

layout(constant_id = 6) const uint METHOD = 15u; /* KILN_GPU_BOTH_...: what the method does */
const bool CONNECTS = (METHOD & KILN_GPU_BOTH_CONNECTS) != 0u, MERGES = (METHOD & KILN_GPU_BOTH_MERGES) != 0u;
const bool POINTS = (METHOD & KILN_GPU_BOTH_POINTS) != 0u, ALONE = (METHOD & KILN_GPU_BOTH_ALONE) != 0u;

#define KILN_LIFTS
#include "shaders/bidirectional.glsl"
#include "shaders/picture.glsl"
#include "shaders/subpaths.glsl"

KILN_ARRAY(PathSums, kiln_gpu_path_sums, 4);

/* Tasks at a vertex, in order: the emitter or sky that is hit; samples of the light tree, of directional lights, of the
 * environment; the continuation. */
const uint MET = 0u, TREE = 1u, SUN = 2u, SKY = 3u, GO_ON = 4u, END = 5u;

uint slot;
kiln_gpu_subpath path;
Vertex here;
bool is_vertex; /* the path has come to one */
uint task, sun; /* sun: the next directional light */
vec3 radiance;  /* that is met */

/* Request of a task. */
bool wants_scatter, wants_light;
vec3 i_; /* to where light comes from */
uint which;
uint light; /* the light whose densities are wanted, seen from a place with a normal; its own place and direction */
real3 light_seen_from, light_seen_about, light_place, light_direction;
real light_cosine;
/* And what it gets. */
bool sends;
Scatter s;
real connect, emission;

kiln_light_sample drawn;
vec3 brings;
Way way; /* on from here */

/* ---- beginning ---- */

void init_from_camera(uint64_t pixel)
{
    const uvec2 place = walk_draw(0u);
    const uint row = uint(pixel / BOTH.width), column = uint(pixel - uint64_t(row) * BOTH.width);
    const real x = (real(column) + real_unit(place.x)) / real(BOTH.width) * 2 - 1,
               y = 1 - (real(row) + real_unit(place.y)) / real(BOTH.height) * 2;
    const vec3 aside = BOTH.right * float(x) + BOTH.up * float(y);
    const bool parallel = BOTH.orthographic != 0u;
    path.origin = parallel ? BOTH.position + aside : BOTH.position;
    path.direction = normalize(parallel ? BOTH.forward : BOTH.forward + aside);
    if (BOTH.lens_radius > 0.0) {
        const vec3 start = lens_place(walk_draw(KILN_PATH_LENS));
        path.origin += start;
        path.direction = normalize((BOTH.forward + aside) * BOTH.focus_distance - start);
    }
    path.weight = float[3](1.0, 1.0, 1.0);
    path.vcm = 0.0;
    path.vc = 0.0;
    path.vm = 0.0;
    path.before = path.origin;
    path.before_normal = vec3(0.0);
    path.surface = 0u;
    path.bounces = 0u;
    path.chain = 0u;
    path.last_diffuse = 0u;
    path.last = KILN_GPU_NONE;
    path.body = KILN_GPU_NONE;
    path.scale = 1.0;
    path.triangle = KILN_GPU_NONE;
    path.u = 0.0;
    path.v = 0.0;
    path.distance = 0.0;
    path.tint = float[3](1.0, 1.0, 1.0);
    path.lift = 0.0;
    SUBPATH(slot) = path;
    for (uint k = 0u; k < KILN_GPU_BOTH_SUM_WORDS; k++)
        BothWords(BOTH.radiance + 4ul * (KILN_GPU_BOTH_SUM_WORDS * uint64_t(slot) + k)).at[0] = 0u;
}

/* ---- what a task asks for ---- */

void ask_scatter(vec3 to_light, uint lobes_)
{
    wants_scatter = true;
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

/* Whether the next vertex of the path may be a light. */
bool may_meet()
{
    if (POINTS) /* light that reaches the point directly belongs to the direct pass */
        return path.surface > 1u && int(path.bounces) <= int(BOTH.most);
    return (path.surface == 0u || CONNECTS || MERGES) && int(path.bounces) - int(path.last_diffuse) <= int(BOTH.most);
}

/* `left`: of the path's weight. */
void shade_background(vec3 left)
{
    brings = may_meet() ? left * kiln_environment_radiance(real3(path.direction)) : vec3(0.0);
    if (path.surface > 0u && CONNECTS && SCENE.lights.environment != 0u && shines(brings))
        ask_light(emission_environment(), real3(path.before), real3(path.before_normal), -real3(path.direction),
                  -real3(path.direction), 1);
}

void shade_light(bool back)
{
    brings = vec3(0.0);
    if ((material_of(here.m.triangle) & KILN_RECORD_EMITS) == 0u || !may_meet())
        return;
    brings = here.weight * kiln_surface_emission(here.m.triangle, here.m.u, here.m.v);
    const uint number =
        path.surface > 0u && CONNECTS ? kiln_area_light_at(here.m.triangle, here.m.u, here.m.v) : KILN_GPU_NONE;
    if (number == KILN_GPU_NONE ||
        (back && (AreaLights(SCENE.lights.areas).at[number].flags & KILN_GPU_LIGHT_TWO_SIDED) == 0u))
        return;
    ask_light(number, real3(path.before), real3(path.before_normal), real3(here.m.position), real3(here.from),
              real(abs(dot(here.m.normal, here.from))));
}

void ask_sample(uint number)
{
    const bool far = isinf(drawn.distance), area = number < SCENE.lights.area_count;
    const real3 p = real3(here.m.position);
    const real cosine =
        area ? abs(dot(real3_of(AreaLights(SCENE.lights.areas).at[number].normal), drawn.direction)) : real(1);
    ask_light(number, p, real3(light_normal(here)), far ? p : p + drawn.direction * drawn.distance, -drawn.direction,
              cosine);
    ask_scatter(vec3(drawn.direction), KILN_LOBE_ALL);
}

void ask_sky()
{
    const uvec2 place = walk_draw(kiln_path_use(path.surface, KILN_PATH_SKY));
    real density;
    drawn.direction = kiln_sky_sample(real_unit(place.x), real_unit(place.y), density);
    drawn.distance = real(KILN_INFINITY);
    drawn.backoff = 0;
    drawn.has_extent = true;
    drawn.value = real3(kiln_environment_radiance(drawn.direction)) / density;
    if (density > 0)
        ask_sample(emission_environment());
}

void ask_lamp()
{
    const uvec2 place = walk_draw(kiln_path_use(path.surface, KILN_PATH_LIGHT)),
                pick = walk_draw(kiln_path_use(path.surface, KILN_PATH_PICK));
    const real3 n = real3(light_normal(here));
    const bool is_sun = task == SUN;
    const kiln_light_choice choice =
        kiln_light_choice(is_sun ? KILN_CHOICE_DIRECTIONAL : KILN_CHOICE_LIGHT_NODE, is_sun ? sun : 0u, 1u);
    if (kiln_sample_choice(choice, 0u, real3(here.m.position), n, n, real_unit(pick.x), real_unit(place.x),
                           real_unit(place.y), drawn))
        ask_sample(is_sun ? emission_directional(sun) : drawn.light);
}

bool ask_go_on()
{
    const uint lobes_ = CONNECTS ? KILN_LOBE_ALL : here.mirrors;
    if (lobes_ == 0u || !way_draw(here, false, lobes_, path.surface, way) || (!CONNECTS && !way.delta))
        return false;
    which = lobes_;
    if (!way.delta)
        ask_scatter(way.direction, lobes_);
    return true;
}

/* ---- arriving ---- */

/* Makes the vertex at the ray's hit; false: the path ends. */
bool settle(kiln_hit hit, vec3 left)
{
    const float cosine = abs(dot(here.m.normal, here.from));
    if (!(cosine > 0.0))
        return false;
    here.weight = left;
#ifdef KILN_GLOSS
    here.weight *= attenuation(hit);
#endif
    here.bounces = path.bounces;
    here.sums = sums_of(path.vcm, path.vc, path.vm);
    if (path.surface == 0u) {
        const real density = camera_density(here.from, length(here.m.position - path.origin), cosine);
        here.sums = kiln_path_sums(real(BOTH.paths) / density, 0, 0);
    } else {
        const vec3 d = here.m.position - path.before;
        kiln_path_arrive(here.sums, real(dot(d, d)), real(cosine));
    }
    return true;
}

/* Processes the surface or sky that the ray has hit. */
void arrive()
{
    const kiln_hit hit = hit_of(path.triangle, path.u, path.v, path.distance);
    const vec3 left = vec3_in(path.weight) * vec3_in(path.tint);
    brings = vec3(0.0);
    is_vertex = false;
    if (hit.triangle == KILN_GPU_NONE) {
        shade_background(left);
    } else if (path.surface == 0u || has_side(hit)) {
        here = vertex_make(hit, path.direction, path.surface == 0u);
        vertex_lift(path.lift, here);
        is_vertex = settle(hit, left);
        if (is_vertex)
            shade_light(hit.back);
    }
}

/* Chooses the first task after an emitter, and stores the vertex for connections and merging. */
void begin_vertex()
{
    task = END;
    if (!is_vertex || here.bounces > BOTH.most || !(CONNECTS || MERGES) ||
        !kiln_path_allows(BOTH.path_length, path.surface + 2u))
        return;
    task = CONNECTS && !here.is_delta ? TREE : GO_ON;
    if (here.is_delta)
        return;
    kiln_gpu_eye_vertex e;
    e.position = here.m.position;
    e.from = here.from;
    e.normal = here.m.normal;
    e.weight = floats_of(here.weight);
    e.vcm = float(here.sums.vcm);
    e.vc = float(here.sums.vc);
    e.vm = float(here.sums.vm);
    e.u = path.u;
    e.v = path.v;
    e.triangle = path.triangle;
    e.surface = path.surface;
    e.bounces = here.bounces;
    e.faces = here.m.gloss || here.m.lifted ? 0u : 1u;
    e.lift = here.m.lift;
    e.vertex = KILN_GPU_NONE;
    if ((METHOD & (KILN_GPU_BOTH_CONNECTS | KILN_GPU_BOTH_OWN)) != 0u && !ALONE)
        e.vertex = BothWords(BOTH.last + 4ul * (uint(push.pixel + slot) - push.first)).at[0];
    e.cell = 0u;
    e.photon = 0u;
    e.photon_end = 0u;
    EYE_VERTEX(slot) = e;
}

/* ---- what a task has found ---- */

void take_met()
{
    real share = 1;
    if (wants_light) {
        const kiln_path_sums sums = sums_of(path.vcm, path.vc, path.vm);
        share = kiln_path_weight_met(is_vertex ? here.sums : sums, connect, emission);
    }
    radiance = brings * float(share);
    begin_vertex();
}

void take_sample()
{
    if (wants_scatter && sends && connect > 0) {
        const real squared = isinf(drawn.distance) ? real(1) : drawn.distance * drawn.distance;
        const real met = drawn.has_extent ? real(s.to_light) * light_cosine / squared : real(0);
        const real share = kiln_path_weight_sampled(path_techniques(), here.sums, connect, emission,
                                                    real(s.landing_i) / squared, met, real(s.to_eye));
        const vec3 start = vertex_start(here, i_);
        float limit;
        const vec3 towards = kiln_shadow_ray(drawn, real3(start - here.m.position), limit);
        const vec3 value = vec3(drawn.value * share);
        Counted sent = Counted(s.all, vec3(0.0));
        if (POINTS)
            sent = counted_product(s, true, vec3(1.0), vec3(0.0), int(BOTH.most) - int(here.bounces));
        sent.all = here.weight * (value * sent.all * s.cosine_i);
        sent.last = here.weight * (value * sent.last * s.cosine_i);
        ask_light_to(start, towards, limit, sent, point_counts(slot), slot);
    }
    if (task == SUN)
        sun++;
    if (task != SKY)
        task = light_kind(KILN_GPU_KIND_SUN) && sun < SCENE.lights.directional_count ? SUN : SKY;
    else
        task = GO_ON;
    if (task == SKY && SCENE.lights.environment == 0u)
        task = GO_ON;
}

void take_way()
{
    bool goes = false;
    task = END;
#ifdef KILN_GLOSS
    if (way.delta)
        goes = way_mirrors(here, false, which, way);
#endif
    if (!way.delta)
        goes = sends && way_scatters(here, false, s, way);
    if (!goes)
        return;
    vec3 weight = here.weight * way.factor;
    kiln_path_sums sums = here.sums;
    kiln_path_leave(path_techniques(), sums, real(way.landing), real(way.forward), real(way.backward), way.delta);
    path.origin = vertex_start(here, way.direction);
    path.direction = way.direction;
    path.vcm = float(sums.vcm);
    path.vc = float(sums.vc);
    path.vm = float(sums.vm);
    path.bounces = here.bounces + (way.diffuse ? 1u : 0u);
    path.last_diffuse = way.diffuse ? 1u : 0u;
    path.chain = way.diffuse ? 0u : path.chain + 1u;
    path.before = here.m.position;
    path.before_normal = light_normal(here);
    if (shines(weight) && path_survives(path.surface, path.chain, weight, weight)) {
        path.surface++;
        path.weight = floats_of(weight);
        SUBPATH(slot) = path;
        go_onward(slot);
    }
}

/* Does one task. The long code that scatters and that weighs a light exists only here. */
void do_task()
{
    bool goes = true;
    wants_scatter = false;
    wants_light = false;
    sends = false;
    if (task == MET)
        arrive();
    else if (CONNECTS && (task == TREE || task == SUN))
        ask_lamp();
    else if (CONNECTS && task == SKY)
        ask_sky();
    else
        goes = ask_go_on();
    if (wants_scatter)
        sends = vertex_scatter(here, here.from, i_, which, s);
    if (CONNECTS && wants_light && (sends || !wants_scatter)) {
        connect = kiln_light_connect(light, light_seen_from, light_seen_about, light_place, light_direction);
        emission = ALONE ? real(0) : kiln_emitted_density(light, light_cosine, light_direction);
    }
    if (task == MET)
        take_met();
    else if (CONNECTS && task != GO_ON)
        take_sample();
    else if (goes)
        take_way();
    else
        task = END;
}

void shade_surface()
{
    path = SUBPATH(slot);
    const uint met_bounces = path.bounces;     /* bounces of a light that is hit, before the path continues */
    EYE_VERTEX(slot).triangle = KILN_GPU_NONE; /* there is none yet to connect */
    if (POINTS && POINT_PATH(slot).goes == 0u)
        return;
    task = MET;
    sun = 0u;
    while (task != END)
        do_task();
    if (shines(radiance))
        add_light_to(slot, Counted(radiance, met_bounces == BOTH.most ? radiance : vec3(0.0)), point_counts(slot));
}

/* ---- the end ---- */

void end()
{
    PathSums all = PathSums(push.sums + 40ul * slot);
    kiln_gpu_path_sums to = all.at[0];
    const vec3 rgb =
        vec3(brought_to_sum(slot, 0u, 0u), brought_to_sum(slot, 0u, 1u), brought_to_sum(slot, 0u, 2u)); /* W/(m2 sr) */
    const float luminance = float_luminance(rgb);
    const float added[4] = float[4](rgb.r, rgb.g, rgb.b, luminance * luminance);
    for (uint c = 0u; c < 4u; c++) {
        kiln_sum sum = kiln_sum(to.high[c], to.low[c]);
        kiln_add(sum, added[c]);
        to.high[c] = sum.high;
        to.low[c] = sum.low;
    }
    to.count++;
    all.at[0] = to;
}

void kiln_kernel(uint x, uint y)
{
    if (y > 0u || !has_work(x))
        return;
    slot = slot_of(x);
    const uint64_t pixel = push.pixel + slot;
    draw_for_eye(slot);
    if (push.stage == KILN_GPU_STAGE_BEGIN)
        init_from_camera(pixel);
    else if (push.stage == KILN_GPU_STAGE_ARRIVE)
        shade_surface();
    else
        end();
}

#include "shaders/main.glsl"
