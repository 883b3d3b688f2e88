/* Where light begins: worker/light/emission.c, branch by branch. Needs shaders/lights.glsl and BOTH
 * (shaders/bidirectional.glsl). */

struct Emitted { /* struct kiln_emitted */
    uint light;
    real3 origin, direction;
    vec3 flux;
    real density, cosine;
    bool has_place, is_point;
};

uint punctual_count() { return BOTH.lights - 1u - SCENE.lights.directional_count - SCENE.lights.area_count; }
uint emission_directional(uint i) { return BOTH.lights - 1u - SCENE.lights.directional_count + i; }
uint emission_environment() { return BOTH.lights - 1u; }

real emission_disc() { return KILN_REAL_PI * real(BOTH.sphere) * real(BOTH.sphere); }

/* ---- densities ---- */

real emission_density(uint light, real cosine, real3 direction)
{
    const real chance = real(LightReals(BOTH.chances).at[light]);
    if (light < SCENE.lights.area_count) {
        const kiln_gpu_area_light area = AreaLights(SCENE.lights.areas).at[light];
        const real sides = (area.flags & KILN_GPU_LIGHT_TWO_SIDED) != 0u ? 2 : 1;
        return chance * cosine / (KILN_REAL_PI * real(area.area) * sides);
    }
    if (light < emission_directional(0u)) {
        const kiln_gpu_point_light point = PointLights(SCENE.lights.points).at[light - SCENE.lights.area_count];
        const bool spot = (point.flags & KILN_GPU_LIGHT_IS_SPOT) != 0u;
        return chance / (2 * KILN_REAL_PI * (spot ? 1 - real(point.cos_outer) : real(2)));
    }
    if (light < emission_environment())
        return chance / emission_disc();
    return chance * kiln_environment_density(-direction) / emission_disc();
}

KILN_ARRAY(TreeWords, uint, 4);

real tree_chance(uint light, real3 p, real3 n)
{
    LightNodes nodes = LightNodes(SCENE.lights.nodes);
    real chance = 1;
    for (uint node = TreeWords(BOTH.leaves).at[light]; node != 0u;) {
        const uint parent = TreeWords(BOTH.parents).at[node], left = nodes.at[parent].left;
        const real a = light_importance(left, p, 0, n), b = light_importance(nodes.at[parent].right, p, 0, n);
        if (!(a + b > 0))
            return 0;
        chance *= (node == left ? a : b) / (a + b);
        node = parent;
    }
    return chance;
}

/* Per m2, of a place on the light, seen from p. */
real area_density(uint index, real3 p, real3 place)
{
    const kiln_gpu_area_light light = AreaLights(SCENE.lights.areas).at[index];
    const stored3 stored0 = stored3_of(light.p0) - stored3(p);
    const real3 to = place - p;
    const real side = real(-dot(stored0, stored3_of(light.normal))), height = abs(side), squared = dot(to, to);
    if (((light.flags & KILN_GPU_LIGHT_TWO_SIDED) != 0u ? height : side) <=
        KILN_AREA_LIGHT_HEIGHT * real(light.rounding))
        return 0;
    const kiln_spherical_triangle t =
        kiln_spherical_triangle_of(real3(stored0), real3_of(light.e1), real3_of(light.e2), real(light.area), height);
    return kiln_spherical_triangle_wanted(t) ? height / (sqrt(squared) * squared * t.omega) : 1 / real(light.area);
}

real emission_connect(uint light, real3 p, real3 n, real3 place, real3 direction)
{
    if (light < emission_directional(0u))
        return tree_chance(light, p, n) * (light < SCENE.lights.area_count ? area_density(light, p, place) : real(1));
    return light < emission_environment() ? real(1) : kiln_environment_density(-direction);
}

/* The area light of a world triangle; KILN_GPU_NONE: it is none. */
uint emission_of_triangle(uint triangle)
{
    uint low = 0u, high = SCENE.lights.area_count;
    while (low < high) {
        const uint middle = (low + high) / 2u;
        if (AreaLights(SCENE.lights.areas).at[middle].triangle < triangle)
            low = middle + 1u;
        else
            high = middle;
    }
    const bool found = low < SCENE.lights.area_count && AreaLights(SCENE.lights.areas).at[low].triangle == triangle;
    return found ? low : KILN_GPU_NONE;
}

/* ---- drawing ---- */

uint emission_pick(real pick)
{
    uint low = 0u, high = BOTH.lights - 1u;
    while (low < high) {
        const uint middle = (low + high) / 2u;
        if (pick < real(LightReals(BOTH.up_to).at[middle]))
            high = middle;
        else
            low = middle + 1u;
    }
    while (low > 0u && !(LightReals(BOTH.chances).at[low] > 0)) /* the sum is rounded */
        low--;
    return low;
}

/* `z` towards the axis. */
real3 emission_about(real3 axis, real x, real y, real z)
{
    vec3 s, t;
    kiln_basis(vec3(axis), s, t);
    return real3(s) * x + real3(t) * y + axis * z;
}

vec3 emission_flux(vec3 light, real factor, real density) { return vec3(real3(light) * (factor / density)); }

void emission_draw_area(real u, real v, real s, real t, inout Emitted ray)
{
    const kiln_gpu_area_light light = AreaLights(SCENE.lights.areas).at[ray.light];
    const real3 on = kiln_triangle_place(real3_of(light.e1), real3_of(light.e2), u, v), normal = real3_of(light.normal);
    const bool two = (light.flags & KILN_GPU_LIGHT_TWO_SIDED) != 0u, back = two && s < KILN_RATIO(1, 2);
    if (two)
        s = back ? 2 * s : 2 * s - 1;
    const real r = sqrt(s), up = sqrt(max(real(0), 1 - s));
    real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * t, sine, cosine);
    ray.origin = real3_of(light.p0) + on;
    ray.direction = real_unit_vector(emission_about(normal, r * cosine, r * sine, back ? -up : up));
    ray.cosine = abs(dot(ray.direction, normal));
    ray.density = emission_density(ray.light, ray.cosine, ray.direction);
    ray.has_place = true;
    ray.flux = emission_flux(area_light_radiance(light, on), ray.cosine, ray.density);
}

void emission_draw_point(real s, real t, inout Emitted ray)
{
    const kiln_gpu_point_light light = PointLights(SCENE.lights.points).at[ray.light - SCENE.lights.area_count];
    if ((light.flags & KILN_GPU_LIGHT_IS_SPOT) != 0u) {
        const real z = 1 - s * (1 - real(light.cos_outer)), r = sqrt(max(real(0), 1 - z * z));
        real sine, cosine;
        real_sincos(2 * KILN_REAL_PI * t, sine, cosine);
        ray.direction = real_unit_vector(emission_about(real3_of(light.direction), r * cosine, r * sine, z));
    } else {
        ray.direction = kiln_sphere_direction(s, t);
    }
    ray.origin = real3_of(light.position);
    ray.density = emission_density(ray.light, 1, ray.direction);
    ray.has_place = true;
    ray.is_point = true;
    ray.flux = emission_flux(vec3_of(light.intensity), point_light_cone(light, ray.direction), ray.density);
}

void emission_draw_outside(vec3 light, real u, real v, inout Emitted ray)
{
    const real sphere = real(BOTH.sphere), r = sphere * sqrt(u);
    real sine, cosine;
    real_sincos(2 * KILN_REAL_PI * v, sine, cosine);
    ray.origin = real3(BOTH.centre) + emission_about(ray.direction, r * cosine, r * sine, -2 * sphere);
    ray.density = emission_density(ray.light, 1, ray.direction);
    ray.flux = emission_flux(light, 1, ray.density);
}

bool emission_draw(real pick, real u, real v, real s, real t, out Emitted ray)
{
    ray = Emitted(emission_pick(pick), real3(0), real3(0), vec3(0.0), 0, 1, false, false);
    if (light_kind(KILN_GPU_KIND_AREA) && ray.light < SCENE.lights.area_count) {
        emission_draw_area(u, v, s, t, ray);
    } else if (light_kind(KILN_GPU_KIND_PUNCTUAL) && ray.light < emission_directional(0u)) {
        emission_draw_point(s, t, ray);
    } else {
        vec3 light;
        if (ray.light < emission_environment()) {
            const uint index = ray.light - emission_directional(0u);
            const kiln_gpu_directional_light sun = DirectionalLights(SCENE.lights.directionals).at[index];
            ray.direction = -real3_of(sun.towards);
            ray.is_point = true;
            light = vec3_of(sun.irradiance);
        } else {
            real density;
            const real3 outwards = kiln_environment_sample(s, t, density);
            light = kiln_environment_radiance(outwards);
            ray.direction = -outwards;
        }
        emission_draw_outside(light, u, v, ray);
    }
    return ray.density > 0 && max(ray.flux.r, max(ray.flux.g, ray.flux.b)) > 0.0;
}
