/* Directions over the hemisphere of a surface point, and the weight of light from there. Needs shaders/position.glsl
 * before it. */
#ifndef KILN_SHADERS_HEMISPHERE_RAY_GLSL
#define KILN_SHADERS_HEMISPHERE_RAY_GLSL

/* Direction with the cosine `cosine` to axis n, at distance `radius` from the axis, rotated about it by v. */
vec3 hemisphere_direction(vec3 n, float radius, float cosine, float v)
{
    const float turn = v - 0.5, a = abs(turn);
    const float sine = kiln_sine_turn(min(a, 0.5 - a));
    vec3 t, b;
    kiln_basis(n, t, b);
    return radius * kiln_sine_turn(0.25 - a) * t + radius * (turn < 0.0 ? -sine : sine) * b + cosine * n;
}

/* Cosine-distributed direction about the axis n; `cosine`: its cosine to n. */
vec3 hemisphere_cosine(vec3 n, float u, float v, out float cosine)
{
    cosine = sqrt(1.0 - u);
    return hemisphere_direction(n, sqrt(u), cosine, v);
}

/* Whether several samples of a point share a position, sample k using position k / reuse; otherwise each has its own.
 */
bool hemisphere_shares(kiln_gpu_point p)
{
    return DRAW_AGAIN != 0u ||
           (p.flags & (KILN_GPU_POINT_PARTIAL | KILN_GPU_POINT_MASKED | KILN_GPU_POINT_LIFTED)) != 0u;
}

/* A ray of a point. */
struct HemisphereRay {
    vec3 axis, direction;
    float cosine;        /* of both */
    float shading;       /* cosine with the shading normal */
    float facet, weight; /* weight of its light, about the geometric and about the shading normal */
};

/* Draws a cosine-distributed ray at a position with the geometric normal `normal`. */
HemisphereRay hemisphere_ray(kiln_gpu_point p, vec3 normal, float u, float v)
{
    const bool smooth_point = HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u;
    const vec3 soft = kiln_shading(p, normal);
    HemisphereRay ray;
    ray.axis = normal;
    float tilt = 1.0;
    if (smooth_point) {                  /* half-way: see kiln_facet_weight */
        const vec3 both = normal + soft; /* 0 where the triangle is too small to have a normal */
        ray.axis = both == vec3(0.0) ? both : normalize(both);
        tilt = dot(normal, ray.axis);
    }
    ray.direction = hemisphere_cosine(ray.axis, u, v, ray.cosine);
    ray.shading = ray.cosine;
    ray.facet = 1.0;
    ray.weight = 1.0;
    if (smooth_point) {
        ray.shading = dot(soft, ray.direction);
        ray.facet = kiln_facet_weight(dot(normal, ray.direction), tilt, ray.cosine);
        ray.weight = kiln_shading_weight(ray.shading, ray.cosine);
    }
    return ray;
}

#endif
