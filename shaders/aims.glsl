/* Where light paths that land begin, and how densely: worker/light/aims.c and targets.c, branch by branch. Needs LAND
 * (struct kiln_gpu_land), and before it shaders/lights.glsl and shaders/emission.glsl. */
KILN_ARRAY(AimLamps, kiln_gpu_lamp, 4);
KILN_ARRAY(AimTargets, kiln_gpu_target, 4);
KILN_ARRAY(AimNumbers, uint64_t, 8);
KILN_ARRAY(AimWords, uint, 4);
KILN_ARRAY(AimFloats, float, 4);

struct Target { /* struct kiln_target */
    real3 centre, low, high;
    real radius;
};

Target target_at(uint index)
{
    const kiln_gpu_target t = AimTargets(LAND.targets).at[index];
    return Target(real3(t.centre), real3(t.low), real3(t.high), real(t.radius));
}

/* The target of a world triangle; KILN_GPU_NONE: none. */
uint target_of(uint triangle) { return AimWords(LAND.of_triangle).at[triangle]; }

/* ---- targets from afar ---- */

real target_disc(Target t) { return KILN_REAL_PI * t.radius * t.radius; }

real3 target_shades(Target t, real3 direction)
{
    const real3 size = t.high - t.low, w = abs(direction);
    return real3(w.x * size.y * size.z, w.y * size.z * size.x, w.z * size.x * size.y);
}

real target_outline(Target t, real3 direction)
{
    const real3 shades = target_shades(t, direction);
    return min(target_disc(t), shades.x + shades.y + shades.z);
}

real3 target_place(Target t, real3 back, real pick, real u, real v)
{
    const real3 shades = target_shades(t, back), size = t.high - t.low;
    const real shade = shades.x + shades.y + shades.z;
    if (!(shade < target_disc(t))) {
        const real r = t.radius * sqrt(u);
        real sine, cosine;
        real_sincos(2 * KILN_REAL_PI * v, sine, cosine);
        return t.centre + emission_about(back, r * cosine, r * sine, 0);
    }
    if (pick * shade < shades.x)
        return real3(back.x > 0 ? t.high.x : t.low.x, t.low.y + u * size.y, t.low.z + v * size.z);
    if (pick * shade < shades.x + shades.y)
        return real3(t.low.x + u * size.x, back.y > 0 ? t.high.y : t.low.y, t.low.z + v * size.z);
    return real3(t.low.x + u * size.x, t.low.y + v * size.y, back.z > 0 ? t.high.z : t.low.z);
}

real target_reach(Target t) { return max(t.radius, length(t.high - t.low) / 2); }

/* ---- targets from a place ---- */

const uint BOX_PARTS = 6u;

/* Half number `part` of the sides of a box that a place sees, whose corners are given from there, as a triangle: two a
 * pair of sides. False: the place does not see that side. */
bool box_part(real3 low, real3 high, uint part, out kiln_spherical_triangle t)
{
    const uint axis = part / 2u, b = (axis + 1u) % 3u, c = (axis + 2u) % 3u;
    const bool is_low = low[axis] > 0;
    real3 corner = low, e1 = real3(0), e2 = real3(0);
    if (!is_low)
        corner[axis] = high[axis];
    e1[b] = high[b] - low[b];
    e2[c] = high[c] - low[c];
    if ((part & 1u) != 0u) {
        corner += e1 + e2;
        e1 = -e1;
        e2 = -e2;
    }
    t = kiln_spherical_triangle_of(corner, e1, e2, (high[b] - low[b]) * (high[c] - low[c]) / 2,
                                   is_low ? low[axis] : -high[axis]);
    return is_low || high[axis] < 0;
}

/* sr: the box as it is seen from there, where that is less than `most`; 0: it is not, or not told from there. */
real box_omega(Target target, real3 from, real most)
{
    const real3 low = target.low - from, high = target.high - from;
    real omega = 0;
    bool is_seen = true;
    for (uint part = 0u; part < BOX_PARTS; part++) {
        kiln_spherical_triangle t;
        if (box_part(low, high, part, t)) {
            is_seen = is_seen && t.omega > 0 && kiln_target_is_apart(t);
            omega += t.omega;
        }
    }
    return is_seen && omega > KILN_SPHERICAL_LEAST && omega < most ? omega : real(0);
}

/* A direction to the box, which is seen from there under `omega`. */
real3 box_direction(Target target, real3 from, real omega, real pick, real u, real v)
{
    const real3 low = target.low - from, high = target.high - from;
    real left = pick * omega;
    kiln_spherical_triangle t, found;
    bool searching = true;
    for (uint part = 0u; part < BOX_PARTS; part++) {
        if (box_part(low, high, part, t) && searching) {
            found = t; /* the last one where rounding leaves none */
            searching = left >= t.omega;
            left -= t.omega;
        }
    }
    return kiln_spherical_triangle_direction(found, u, v);
}

/* ---- cones ---- */

const real AIM_SLACK = real(1.0001LF);

/* 1 less the cosine of half the cone in which a target's sphere is seen; 2 from within. */
real cone_height(Target target, real3 from)
{
    const real3 to = target.centre - from;
    const real sine2 = target.radius * target.radius / dot(to, to);
    return sine2 < 1 ? sine2 / (1 + sqrt(1 - sine2)) : real(2);
}

real3 cone_direction(real3 axis, real height, real u, real v)
{
    const real below = u * height, r = sqrt(below * (2 - below));
    real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * v, sine, cosine);
    return emission_about(axis, r * cosine, r * sine, 1 - below);
}

real cone_density(real3 axis, real height, real3 direction)
{
    return 1 - dot(axis, direction) <= AIM_SLACK * height ? 1 / (2 * KILN_REAL_PI * height) : real(0);
}

real3 aim_towards(Target target, real3 from)
{
    const real3 to = target.centre - from;
    const real far = length(to);
    return far > 0 ? to * (1 / far) : real3(0, 0, 1);
}

/* Of an emitting triangle: the cone is so wide that directions are drawn by the cosine; and of which box it is worse.
 */
bool cone_is_wide(real height) { return height > KILN_RATIO(1, 2); }
real box_most(real height) { return 2 * KILN_REAL_PI * (cone_is_wide(height) ? KILN_RATIO(1, 2) : height); }

/* The cone that a point or spot sends to: 1 less the cosine of half its angle, and its axis. */
real point_cone(kiln_gpu_point_light light, Target target, out real3 axis)
{
    const real3 place = real3_of(light.position);
    const real height = cone_height(target, place), own = 1 - real(light.cos_outer);
    const bool narrow = (light.flags & KILN_GPU_LIGHT_IS_SPOT) != 0u && own < height;
    axis = narrow ? real3_of(light.direction) : aim_towards(target, place);
    return narrow ? own : height;
}

real light_sides(kiln_gpu_area_light light) { return (light.flags & KILN_GPU_LIGHT_TWO_SIDED) != 0u ? 2 : 1; }

/* Luminance of what an emitting triangle sends over that of its lamp. */
real area_chance(kiln_gpu_area_light light, float lamp_flux)
{
    return KILN_REAL_PI * real(light.area) * light_sides(light) * real_luminance(real3(vec3_of(light.radiance))) /
           real(lamp_flux);
}

/* ---- rays ---- */

struct AimedRay { /* struct kiln_aimed_ray */
    vec3 origin, direction;
    real3 flux;
    real range;
    uint light;
    real3 place;
    real cosine;
    bool has_place, is_point;
    uint triangle;
};

/* Random numbers: triangle, side; place; direction. */
struct AimNumber {
    real triangle, side, s, t, u, v;
};

void aim_outside(Target target, real3 back, real3 through, inout AimedRay ray)
{
    const real away = real(LAND.radius) + length(target.centre - real3(LAND.centre)) + target_reach(target);
    ray.place = through + back * away;
    ray.origin = vec3(ray.place);
    ray.direction = vec3(-back);
}

void aim_point(uint index, Target target, AimNumber n, inout AimedRay ray)
{
    const kiln_gpu_point_light light = PointLights(SCENE.lights.points).at[index];
    const real3 place = real3_of(light.position);
    real3 axis;
    const real used = point_cone(light, target, axis), omega = box_omega(target, place, 2 * KILN_REAL_PI * used);
    const real3 direction =
        omega > 0 ? box_direction(target, place, omega, n.side, n.u, n.v) : cone_direction(axis, used, n.u, n.v);
    ray.origin = vec3(place);
    ray.direction = vec3(direction);
    ray.place = place;
    ray.range = real(light.range);
    ray.has_place = true;
    ray.is_point = true;
    ray.flux = real3(vec3_of(light.intensity)) *
               ((omega > 0 ? omega : 2 * KILN_REAL_PI * used) * point_light_cone(light, direction));
}

/* The first of `count` ascending sums from number `first` on that is above `pick`; the last where none is. */
uint first_above(uint64_t sums, uint first, uint count, real pick)
{
    uint low = first, high = first + count - 1u;
    while (low < high) {
        const uint middle = low + (high - low) / 2u;
        if (real(AimFloats(sums).at[middle]) > pick)
            high = middle;
        else
            low = middle + 1u;
    }
    return low;
}

/* The emitting triangle of a lamp that `pick` falls to. */
uint aim_area_of(kiln_gpu_lamp lamp, real pick)
{
    return first_above(LAND.until, lamp.first, lamp.count, pick);
}

/* The ray leaves an emitting triangle at the place `on` from its corner 0, and has `factor` of its radiance. */
bool leave_area(kiln_gpu_area_light light, real3 on, real side, real3 direction, real factor, inout AimedRay ray)
{
    const real3 normal = real3_of(light.normal);
    const float offset = triangle_at(light.triangle).offset;
    ray.place = real3_of(light.p0) + on;
    ray.origin = vec3(ray.place) + vec3(normal * side) * offset;
    ray.direction = vec3(direction);
    ray.cosine = side * dot(normal, direction);
    ray.has_place = true;
    ray.flux = real3(area_light_radiance(light, on)) * factor;
    return factor > 0;
}

bool aim_area(kiln_gpu_lamp lamp, Target target, AimNumber n, inout AimedRay ray)
{
    ray.light = aim_area_of(lamp, n.triangle);
    const kiln_gpu_area_light light = AreaLights(SCENE.lights.areas).at[ray.light];
    const real3 on = kiln_triangle_place(real3_of(light.e1), real3_of(light.e2), n.s, n.t),
                at = real3_of(light.p0) + on, normal = real3_of(light.normal);
    const bool two = (light.flags & KILN_GPU_LIGHT_TWO_SIDED) != 0u;
    const real height = cone_height(target, at), omega = box_omega(target, at, box_most(height));
    real factor = real(light.area) / area_chance(light, lamp.flux), side = 1;
    real3 direction;
    if (!(omega > 0) && cone_is_wide(height)) {
        side = two && n.side < KILN_RATIO(1, 2) ? -1 : 1;
        direction = cosine_direction(normal * side, n.u, n.v);
        factor *= KILN_REAL_PI * light_sides(light);
    } else {
        direction = omega > 0 ? box_direction(target, at, omega, n.side, n.u, n.v)
                              : cone_direction(aim_towards(target, at), height, n.u, n.v);
        const real cosine = dot(normal, direction);
        side = two && cosine < 0 ? -1 : 1;
        factor *= (omega > 0 ? omega : 2 * KILN_REAL_PI * height) * side * cosine;
    }
    return leave_area(light, on, side, direction, factor, ray);
}

uint aim_light_of(kiln_gpu_lamp lamp)
{
    const uint before = lamp.kind == KILN_GPU_LAMP_AREA          ? 0u
                        : lamp.kind == KILN_GPU_LAMP_POINT       ? SCENE.lights.area_count
                        : lamp.kind == KILN_GPU_LAMP_DIRECTIONAL ? emission_directional(0u)
                                                                 : emission_environment();
    return before + lamp.first;
}

/* Towards what a directional light or the environment sends its light from; `density`: of that direction. */
vec3 aim_from_outside(kiln_gpu_lamp lamp, AimNumber n, out real3 back, out real density, inout AimedRay ray)
{
    density = 1;
    if (light_kind(KILN_GPU_KIND_SUN) && lamp.kind == KILN_GPU_LAMP_DIRECTIONAL) {
        const kiln_gpu_directional_light sun = DirectionalLights(SCENE.lights.directionals).at[lamp.first];
        back = real3_of(sun.towards);
        ray.is_point = true;
        return vec3_of(sun.irradiance);
    }
    back = kiln_environment_sample(n.u, n.v, density);
    return kiln_environment_radiance(back);
}

/* By sphere or box. */
bool aim_by_outline(kiln_gpu_lamp lamp, Target target, AimNumber n, inout AimedRay ray)
{
    if (light_kind(KILN_GPU_KIND_AREA) && lamp.kind == KILN_GPU_LAMP_AREA)
        return aim_area(lamp, target, n, ray);
    if (light_kind(KILN_GPU_KIND_PUNCTUAL) && lamp.kind == KILN_GPU_LAMP_POINT) {
        aim_point(lamp.first, target, n, ray);
        return true;
    }
    real3 back;
    real density;
    const vec3 light = aim_from_outside(lamp, n, back, density, ray);
    aim_outside(target, back, target_place(target, back, n.side, n.s, n.t), ray);
    ray.flux = real3(light) * (target_outline(target, back) / density);
    return density > 0;
}

/* ---- rays that go evenly over triangles ---- */

/* The triangle of a target that `pick` falls to. */
uint even_pick(kiln_gpu_target target, real pick)
{
    return AimWords(LAND.triangles).at[first_above(LAND.shares, target.listed, target.count, pick)];
}

/* The density of those that go to this triangle: per m2 across the direction, or per steradian from a place. */
real even_across(uint triangle, real3 direction)
{
    const real cosine = abs(dot(real3(triangle_at(triangle).normal), direction));
    return cosine > 0 ? 1 / (real(AimTargets(LAND.targets).at[target_of(triangle)].area) * cosine) : real(0);
}
real even_from(uint triangle, real3 place, real3 direction)
{
    const kiln_gpu_path_triangle t = triangle_at(triangle);
    const real3 normal = real3(t.normal);
    const real cosine = dot(normal, direction), height = dot(real3(t.p) - place, normal);
    if (!(cosine * height > 0))
        return 0;
    const real far = height / cosine;
    return far * far / (real(AimTargets(LAND.targets).at[target_of(triangle)].area) * abs(cosine));
}

real even_density(kiln_gpu_lamp lamp, uint light, uint triangle, real3 place, real3 direction)
{
    if (light_kind(KILN_GPU_KIND_AREA) && lamp.kind == KILN_GPU_LAMP_AREA) {
        const kiln_gpu_area_light area = AreaLights(SCENE.lights.areas).at[light];
        if ((area.flags & KILN_GPU_LIGHT_TWO_SIDED) == 0u && !(dot(real3_of(area.normal), direction) > 0))
            return 0;
        return area_chance(area, lamp.flux) / real(area.area) * even_from(triangle, place, direction);
    }
    if (light_kind(KILN_GPU_KIND_SUN) && lamp.kind == KILN_GPU_LAMP_DIRECTIONAL)
        return even_across(triangle, direction);
    return kiln_environment_density(-direction) * even_across(triangle, direction);
}

/* From an emitting triangle of the lamp to the place `to` on the ray's triangle, which was drawn evenly; likewise from
 * outside. */
bool even_area(kiln_gpu_lamp lamp, AimNumber n, real3 to, inout AimedRay ray)
{
    ray.light = aim_area_of(lamp, n.triangle);
    const kiln_gpu_area_light light = AreaLights(SCENE.lights.areas).at[ray.light];
    const real3 on = kiln_triangle_place(real3_of(light.e1), real3_of(light.e2), n.s, n.t),
                at = real3_of(light.p0) + on, direction = real3(vec3(normalize(to - at)));
    const real cosine = dot(real3_of(light.normal), direction),
               side = (light.flags & KILN_GPU_LIGHT_TWO_SIDED) != 0u && cosine < 0 ? -1 : 1,
               density = even_density(lamp, ray.light, ray.triangle, at, direction);
    return density > 0 && leave_area(light, on, side, direction, side * cosine / density, ray);
}

bool even_outside(kiln_gpu_lamp lamp, Target target, AimNumber n, real3 to, inout AimedRay ray)
{
    real3 back;
    real density;
    const vec3 light = aim_from_outside(lamp, n, back, density, ray);
    aim_outside(target, back, to, ray);
    density *= even_across(ray.triangle, real3(ray.direction));
    if (density > 0)
        ray.flux = real3(light) * (1 / density);
    return density > 0;
}

bool aim_evenly(kiln_gpu_lamp lamp, uint target, AimNumber n, inout AimedRay ray)
{
    const bool outside = lamp.kind != KILN_GPU_LAMP_AREA;
    ray.triangle = even_pick(AimTargets(LAND.targets).at[target], n.side);
    const kiln_gpu_path_triangle t = triangle_at(ray.triangle);
    const real3 to =
        real3(t.p) + kiln_triangle_place(real3(t.e1), real3(t.e2), outside ? n.s : n.u, outside ? n.t : n.v);
    if (light_kind(KILN_GPU_KIND_AREA) && !outside)
        return even_area(lamp, n, to, ray);
    return even_outside(lamp, target_at(target), n, to, ray);
}

/* ---- both ---- */

bool aim_draw(uint aim, uint64_t k, AimNumber n, out AimedRay ray)
{
    const kiln_gpu_lamp lamp = AimLamps(LAND.lamps).at[aim / LAND.target_count];
    const uint target = aim % LAND.target_count;
    ray = AimedRay(vec3(0.0), vec3(0.0), real3(0), 0, aim_light_of(lamp), real3(0), 1, false, false, KILN_GPU_NONE);
    return k < AimNumbers(LAND.even).at[aim] ? aim_evenly(lamp, target, n, ray)
                                             : aim_by_outline(lamp, target_at(target), n, ray);
}

/* The aim of a path of an iteration. */
uint aim_find(uint64_t path)
{
    uint low = 0u, high = LAND.aim_count;
    while (high - low > 1u) {
        const uint middle = low + (high - low) / 2u;
        if (AimNumbers(LAND.first).at[middle] <= path)
            low = middle;
        else
            high = middle;
    }
    return low;
}

real aim_paths(uint aim)
{
    AimNumbers first = AimNumbers(LAND.first);
    return real(first.at[aim + 1u] - first.at[aim]);
}

/* ---- densities ---- */

real aim_area_density(uint index, float lamp_flux, Target target, real3 place, real3 direction)
{
    const kiln_gpu_area_light light = AreaLights(SCENE.lights.areas).at[index];
    const real height = cone_height(target, place), cosine = dot(real3_of(light.normal), direction),
               chance = area_chance(light, lamp_flux) / real(light.area);
    if ((light.flags & KILN_GPU_LIGHT_TWO_SIDED) == 0u && !(cosine > 0))
        return 0;
    const real omega = box_omega(target, place, box_most(height));
    if (omega > 0)
        return chance / omega;
    return chance * (cone_is_wide(height) ? abs(cosine) / (KILN_REAL_PI * light_sides(light))
                                          : cone_density(aim_towards(target, place), height, direction));
}

real aim_point_density(uint index, Target target, real3 direction)
{
    const kiln_gpu_point_light light = PointLights(SCENE.lights.points).at[index];
    real3 axis;
    const real height = point_cone(light, target, axis),
               omega = box_omega(target, real3_of(light.position), 2 * KILN_REAL_PI * height);
    return omega > 0 ? 1 / omega : cone_density(axis, height, direction);
}

/* The lamp that a light is a part of. */
uint lamp_of_light(uint light)
{
    const uint areas = SCENE.lights.area_count;
    AimWords lamps = AimWords(LAND.lamp_of);
    if (light < areas)
        return lamps.at[light];
    return (areas > 0u ? lamps.at[areas - 1u] + 1u : 0u) + (light - areas);
}

/* Of so many paths whose rays go by sphere or box. */
real aim_outline_density(kiln_gpu_lamp lamp, uint light, Target t, real paths, real3 place, real3 direction)
{
    if (light_kind(KILN_GPU_KIND_AREA) && lamp.kind == KILN_GPU_LAMP_AREA)
        return paths * aim_area_density(light, lamp.flux, t, place, direction);
    if (light_kind(KILN_GPU_KIND_PUNCTUAL) && lamp.kind == KILN_GPU_LAMP_POINT)
        return paths * aim_point_density(lamp.first, t, direction);
    if (light_kind(KILN_GPU_KIND_SUN) && lamp.kind == KILN_GPU_LAMP_DIRECTIONAL)
        return paths / target_outline(t, real3_of(DirectionalLights(SCENE.lights.directionals).at[lamp.first].towards));
    return paths * kiln_environment_density(-direction) / target_outline(t, -direction);
}

/* kiln_aims_met. */
real aim_met(uint aim, AimedRay ray, uint triangle)
{
    const uint target = aim % LAND.target_count;
    const real even = real(AimNumbers(LAND.even).at[aim]), all = aim_paths(aim);
    if (target_of(triangle) != target || (ray.triangle != KILN_GPU_NONE && ray.triangle != triangle))
        return 0;
    if (!(even > 0))
        return 1;
    const kiln_gpu_lamp lamp = AimLamps(LAND.lamps).at[aim / LAND.target_count];
    const real3 direction = real3(ray.direction);
    const real by_outline = aim_outline_density(lamp, ray.light, target_at(target), all - even, ray.place, direction),
               by_triangle = even * even_density(lamp, ray.light, triangle, ray.place, direction),
               own = ray.triangle != KILN_GPU_NONE ? by_triangle / even : by_outline / (all - even);
    return own > 0 ? all * own / (by_outline + by_triangle) : real(0);
}

/* kiln_aims_density. */
real aim_density(uint light, uint triangle, real3 place, real3 direction)
{
    const uint target = target_of(triangle);
    if (target == KILN_GPU_NONE)
        return 0;
    const uint number = lamp_of_light(light), aim = number * LAND.target_count + target;
    const kiln_gpu_lamp lamp = AimLamps(LAND.lamps).at[number];
    const real all = aim_paths(aim), even = real(AimNumbers(LAND.even).at[aim]),
               by_outline = aim_outline_density(lamp, light, target_at(target), all - even, place, direction);
    return even > 0 ? by_outline + even * even_density(lamp, light, triangle, place, direction) : by_outline;
}
