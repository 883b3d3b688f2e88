/* Walking struct kiln_gpu_node2, the nearer child first (Aila and Laine 2009). Part of trace/compute.glsl. */

/* Does the ray meet the box before `limit`? `slab` holds where it crosses the lower and upper planes; `near` is where
 * it enters. */
bool kiln_meets(vec2 x, vec2 y, vec2 z, float limit, out float near)
{
    near = max(max(min(x.x, x.y), min(y.x, y.y)), max(min(z.x, z.y), 0.0));
    return near <= min(min(max(x.x, x.y), max(y.x, y.y)), min(max(z.x, z.y), limit));
}

void kiln_walk_binary(const kiln_ray ray, bool any, inout kiln_found found)
{
    TraceQuads nodes = TraceQuads(SCENE.trace.nodes), triangles = TraceQuads(SCENE.trace.triangles);
    const vec3 inverse = kiln_inverse(ray.direction), shift = -ray.origin * inverse;
    uint stack[KILN_GPU_STACK2], depth = 0u;
    stack[depth++] = KILN_GPU_NONE; /* counts as a leaf and ends the walk */
    uint node = 0u;
    while (node != KILN_GPU_NONE) {
        while (node < KILN_GPU_LEAF) {
            const vec4 xy0 = uintBitsToFloat(nodes.at[4u * node]), xy1 = uintBitsToFloat(nodes.at[4u * node + 1u]);
            const vec4 z = fma(uintBitsToFloat(nodes.at[4u * node + 2u]), inverse.zzzz, shift.zzzz);
            const uvec2 child = nodes.at[4u * node + 3u].xy;
            const vec4 t0 = fma(xy0, inverse.xxyy, shift.xxyy), t1 = fma(xy1, inverse.xxyy, shift.xxyy);
            float near0, near1;
            const bool meets0 = kiln_meets(t0.xy, t0.zw, z.xy, found.distance, near0);
            const bool meets1 = kiln_meets(t1.xy, t1.zw, z.zw, found.distance, near1);
            if (meets0 || meets1) {
                const bool second = meets1 && (!meets0 || near1 < near0);
                node = second ? child.y : child.x;
                if (meets0 && meets1)
                    stack[depth++] = second ? child.x : child.y;
            } else
                node = stack[--depth];
        }
        while (node >= KILN_GPU_LEAF && node != KILN_GPU_NONE) {
            const uint leaf = node;
            node = stack[--depth];
            if (kiln_test_leaf(ray, triangles, leaf, any, found))
                return;
        }
    }
}
