/* Traversal of struct kiln_gpu_bvh4_node, children in the order in which the ray enters them. Part of
 * trace/compute.glsl. */

/* Puts the nearer of two children first. */
void kiln_order(inout float near_a, inout uint child_a, inout float near_b, inout uint child_b)
{
    const bool swap = near_b < near_a;
    const float near = swap ? near_b : near_a;
    const uint child = swap ? child_b : child_a;
    near_b = swap ? near_a : near_b;
    child_b = swap ? child_a : child_b;
    near_a = near;
    child_a = child;
}

void kiln_walk_four(const kiln_ray ray, bool any, inout kiln_found found)
{
    TraceQuads nodes = TraceQuads(SCENE.trace.nodes), triangles = TraceQuads(SCENE.trace.triangles);
    const vec3 inverse = kiln_inverse(ray.direction), shift = -ray.origin * inverse;
    const uvec3 entry = uvec3(inverse.x < 0.0 ? 1u : 0u, inverse.y < 0.0 ? 3u : 2u,
                              inverse.z < 0.0 ? 5u : 4u); /* the plane met first */
    const float infinity = uintBitsToFloat(0x7f800000u);
    uint stack[KILN_GPU_STACK4], depth = 0u;
    stack[depth++] = KILN_GPU_NONE;
    uint node = 0u;
    while (node != KILN_GPU_NONE) {
        while (node < KILN_GPU_LEAF) {
            const uint at = 8u * node;
            const vec4 near_x = fma(uintBitsToFloat(nodes.at[at + entry.x]), inverse.xxxx, shift.xxxx);
            const vec4 far_x = fma(uintBitsToFloat(nodes.at[at + (entry.x ^ 1u)]), inverse.xxxx, shift.xxxx);
            const vec4 near_y = fma(uintBitsToFloat(nodes.at[at + entry.y]), inverse.yyyy, shift.yyyy);
            const vec4 far_y = fma(uintBitsToFloat(nodes.at[at + (entry.y ^ 1u)]), inverse.yyyy, shift.yyyy);
            const vec4 near_z = fma(uintBitsToFloat(nodes.at[at + entry.z]), inverse.zzzz, shift.zzzz);
            const vec4 far_z = fma(uintBitsToFloat(nodes.at[at + (entry.z ^ 1u)]), inverse.zzzz, shift.zzzz);
            uvec4 child = nodes.at[at + 6u];
            const vec4 enter = max(max(near_x, near_y), max(near_z, vec4(0.0)));
            const vec4 leave = min(min(far_x, far_y), min(far_z, vec4(found.distance)));
            vec4 near = mix(vec4(infinity), enter, lessThanEqual(enter, leave));
            if (any) { /* any order will do, but hit children must come first */
                kiln_order(near.x, child.x, near.z, child.z);
                kiln_order(near.y, child.y, near.w, child.w);
                kiln_order(near.x, child.x, near.y, child.y);
            } else {
                kiln_order(near.x, child.x, near.z, child.z);
                kiln_order(near.y, child.y, near.w, child.w);
                kiln_order(near.x, child.x, near.y, child.y);
                kiln_order(near.z, child.z, near.w, child.w);
                kiln_order(near.y, child.y, near.z, child.z);
            }
            if (near.w < infinity)
                stack[depth++] = child.w;
            if (near.z < infinity)
                stack[depth++] = child.z;
            if (near.y < infinity)
                stack[depth++] = child.y;
            if (near.x < infinity)
                node = child.x;
            else
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
