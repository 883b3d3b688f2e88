/* Cosine-distributed rays of hemisphere.glsl about the axis half-way between the geometric and the shading normal, and
 * the weights of what they meet: kiln_facet_weight and kiln_shading_weight of shaders/shared/warp.h. */
struct Ray {
    vec3 direction;
    vec3 shading;        /* the shading normal */
    vec3 normal;         /* the geometric one */
    float tilt, cosine;  /* cosines between geometric normal and axis, direction and axis */
    bool smooth_surface; /* the normals may differ; else both weights are 1 */
};

Ray cosine_ray(kiln_gpu_point p, vec3 normal, float u, float v)
{
    Ray ray;
    ray.smooth_surface = HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u;
    ray.shading = kiln_shading(p, normal);
    ray.normal = normal;
    ray.tilt = 1.0;
    vec3 axis = normal;
    if (ray.smooth_surface) {
        const vec3 both = normal + ray.shading; /* 0 where the triangle is too small to have a normal */
        axis = both == vec3(0.0) ? both : normalize(both);
        ray.tilt = dot(normal, axis);
    }
    ray.cosine = sqrt(1.0 - u);
    ray.direction = hemisphere_direction(axis, sqrt(u), ray.cosine, v);
    return ray;
}

/* Weights of what arrives about the geometric normal (0: the ray goes below the surface) and about the shading one. */
void ray_weights(Ray ray, out float facet, out float shading)
{
    facet = 1.0;
    shading = 1.0;
    if (ray.smooth_surface) {
        facet = kiln_facet_weight(dot(ray.normal, ray.direction), ray.tilt, ray.cosine);
        shading = kiln_shading_weight(dot(ray.shading, ray.direction), ray.cosine);
    }
}
