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
};

/* Random numbers: triangle, side; place; direction. */
struct AimNumber {
    real triangle, side, s, t, u, v;
};

void aim_outside(Target target, real3 back, AimNumber n, inout AimedRay ray)
{
    const real away = real(LAND.radius) + length(target.centre - real3(LAND.centre)) + target_reach(target);
    ray.place = target_place(target, back, n.side, n.s, n.t) + back * away;
    ray.origin = vec3(ray.place);
    ray.direction = vec3(-back);
}

void aim_point(uint index, Target target, AimNumber n, inout AimedRay ray)
{
    const kiln_gpu_point_light light = PointLights(SCENE.lights.points).at[index];
    real3 axis;
    const real used = point_cone(light, target, axis);
    ray.place = real3_of(light.position);
    const real omega = box_omega(target, ray.place, 2 * KILN_REAL_PI * used);
    const real3 direction =
        omega > 0 ? box_direction(target, ray.place, omega, n.side, n.u, n.v) : cone_direction(axis, used, n.u, n.v);
    ray.origin = vec3(ray.place);
    ray.direction = vec3(direction);
    ray.range = real(light.range);
    ray.has_place = true;
    ray.is_point = true;
    ray.flux = real3(vec3_of(light.intensity)) *
               ((omega > 0 ? omega : 2 * KILN_REAL_PI * used) * point_light_cone(light, direction));
}

/* The emitting triangle of a lamp that `pick` falls to. */
uint aim_area_of(kiln_gpu_lamp lamp, real pick)
{
    uint low = lamp.first, high = lamp.first + lamp.count - 1u;
    while (low < high) {
        const uint middle = low + (high - low) / 2u;
        if (real(AimFloats(LAND.until).at[middle]) > pick)
            high = middle;
        else
            low = middle + 1u;
    }
    return low;
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
    const float offset = triangle_at(light.triangle).offset;
    ray.origin = vec3(at) + vec3(normal * side) * offset;
    ray.direction = vec3(direction);
    ray.place = at;
    ray.cosine = side * dot(normal, direction);
    ray.has_place = true;
    ray.flux = real3(area_light_radiance(light, on)) * factor;
    return factor > 0;
}

uint aim_light_of(kiln_gpu_lamp lamp)
{
    const uint before = lamp.kind == KILN_GPU_LAMP_AREA          ? 0u
                        : lamp.kind == KILN_GPU_LAMP_POINT       ? SCENE.lights.area_count
                        : lamp.kind == KILN_GPU_LAMP_DIRECTIONAL ? emission_directional(0u)
                                                                 : emission_environment();
    return before + lamp.first;
}

bool aim_draw(uint aim, AimNumber n, out AimedRay ray)
{
    const kiln_gpu_lamp lamp = AimLamps(LAND.lamps).at[aim / LAND.target_count];
    const Target target = target_at(aim % LAND.target_count);
    ray = AimedRay(vec3(0.0), vec3(0.0), real3(0), 0, aim_light_of(lamp), real3(0), 1, false, false);
    if (light_kind(KILN_GPU_KIND_AREA) && lamp.kind == KILN_GPU_LAMP_AREA)
        return aim_area(lamp, target, n, ray);
    if (light_kind(KILN_GPU_KIND_PUNCTUAL) && lamp.kind == KILN_GPU_LAMP_POINT) {
        aim_point(lamp.first, target, n, ray);
        return true;
    }
    real3 back;
    vec3 light;
    real density = 1;
    if (light_kind(KILN_GPU_KIND_SUN) && lamp.kind == KILN_GPU_LAMP_DIRECTIONAL) {
        const kiln_gpu_directional_light sun = DirectionalLights(SCENE.lights.directionals).at[lamp.first];
        back = real3_of(sun.towards);
        light = vec3_of(sun.irradiance);
        ray.is_point = true;
    } else {
        back = kiln_environment_sample(n.u, n.v, density);
        light = kiln_environment_radiance(back);
    }
    aim_outside(target, back, n, ray);
    ray.flux = real3(light) * (target_outline(target, back) / density);
    return density > 0;
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

/* kiln_aims_density. */
real aim_density(uint light, uint target, real3 place, real3 direction)
{
    if (target == KILN_GPU_NONE)
        return 0;
    const uint lamp = lamp_of_light(light);
    const kiln_gpu_lamp of = AimLamps(LAND.lamps).at[lamp];
    const Target t = target_at(target);
    const real paths = aim_paths(lamp * LAND.target_count + target);
    if (light_kind(KILN_GPU_KIND_AREA) && of.kind == KILN_GPU_LAMP_AREA)
        return paths * aim_area_density(light, of.flux, t, place, direction);
    if (light_kind(KILN_GPU_KIND_PUNCTUAL) && of.kind == KILN_GPU_LAMP_POINT)
        return paths * aim_point_density(of.first, t, direction);
    if (light_kind(KILN_GPU_KIND_SUN) && of.kind == KILN_GPU_LAMP_DIRECTIONAL)
        return paths / target_outline(t, real3_of(DirectionalLights(SCENE.lights.directionals).at[of.first].towards));
    return paths * kiln_environment_density(-direction) / target_outline(t, -direction);
}
