/* Traversal of struct kiln_gpu_bvh8_node (Ylitie, Karras and Laine 2017, sections 3 and 4). Part of trace/compute.glsl.
 *
 * A group of nodes is two words: the index of the first; and a mask of slots still to be visited (bits 24 to 31, in the
 * order of the ray's octant) and of slots that are nodes (bits 0 to 7). A group of triangles: the index of the first,
 * and a mask of those still to be tested. */

float kiln_byte(uint word, int which) { return float(bitfieldExtract(word, 8 * which, 8)); }

/* Hit mask of a node's children: bits 24 to 31 nodes, in the order of the octant; bits 0 to 23 triangles. */
uint kiln_meets_eight(uvec4 quads[5], vec3 origin, vec3 inverse, uint octant, float limit)
{
    const vec3 step_size = uintBitsToFloat(
        uvec3(bitfieldExtract(quads[0].w, 0, 8), bitfieldExtract(quads[0].w, 8, 8), bitfieldExtract(quads[0].w, 16, 8))
        << 23);
    const vec3 scale = step_size * inverse, shift = (uintBitsToFloat(quads[0].xyz) - origin) * inverse;
    const bvec3 negative = lessThan(inverse, vec3(0.0));
    uint mask = 0u;
    for (int half_node = 0; half_node < 2; half_node++) {
        const uint meta = half_node == 0 ? quads[1].z : quads[1].w;
        const uint inner = (meta & (meta << 1)) & 0x10101010u;
        const uint place = (meta ^ (octant * 0x01010101u & (inner >> 4) * 0xffu)) & 0x1f1f1f1fu;
        const uint bits = meta >> 5 & 0x07070707u;
        const uvec3 lower =
            half_node == 0 ? uvec3(quads[2].x, quads[2].z, quads[3].x) : uvec3(quads[2].y, quads[2].w, quads[3].y);
        const uvec3 upper =
            half_node == 0 ? uvec3(quads[3].z, quads[4].x, quads[4].z) : uvec3(quads[3].w, quads[4].y, quads[4].w);
        const uvec3 near_plane = mix(lower, upper, negative), far_plane = mix(upper, lower, negative);
        for (int i = 0; i < 4; i++) {
            const vec3 enter = fma(
                vec3(kiln_byte(near_plane.x, i), kiln_byte(near_plane.y, i), kiln_byte(near_plane.z, i)), scale, shift);
            const vec3 leave = fma(
                vec3(kiln_byte(far_plane.x, i), kiln_byte(far_plane.y, i), kiln_byte(far_plane.z, i)), scale, shift);
            if (max(max(enter.x, enter.y), max(enter.z, 0.0)) <= min(min(leave.x, leave.y), min(leave.z, limit)))
                mask |= bitfieldExtract(bits, 8 * i, 8) << bitfieldExtract(place, 8 * i, 8);
        }
    }
    return mask;
}

void kiln_walk_eight(const kiln_ray ray, bool any, inout kiln_found found)
{
    TraceQuads nodes = TraceQuads(SCENE.trace.nodes), triangles = TraceQuads(SCENE.trace.triangles);
    const vec3 inverse = kiln_inverse(ray.direction);
    const uint octant = (inverse.x < 0.0 ? 0u : 4u) | (inverse.y < 0.0 ? 0u : 2u) | (inverse.z < 0.0 ? 0u : 1u);
    uvec2 stack[KILN_GPU_STACK8];
    uint depth = 0u;
    uvec2 group = uvec2(0u, 0x80000000u), leaves = uvec2(0u);
    for (;;) {
        if (group.y > 0x00ffffffu) {
            const uint bit = uint(findMSB(group.y)), slot = (bit - 24u) ^ octant;
            const uint node = group.x + uint(bitCount(group.y & ((1u << slot) - 1u) & 0xffu));
            group.y &= ~(1u << bit);
            if (group.y > 0x00ffffffu)
                stack[depth++] = group;
            const uvec4 quads[5] = uvec4[5](nodes.at[5u * node], nodes.at[5u * node + 1u], nodes.at[5u * node + 2u],
                                            nodes.at[5u * node + 3u], nodes.at[5u * node + 4u]);
            const uint mask = kiln_meets_eight(quads, ray.origin, inverse, octant, found.distance);
            group = uvec2(quads[1].x, (mask & 0xff000000u) | quads[0].w >> 24);
            leaves = uvec2(quads[1].y, mask & 0x00ffffffu);
        } else {
            leaves = group;
            group = uvec2(0u);
        }
        while (leaves.y != 0u) {
            const uint bit = uint(findLSB(leaves.y));
            leaves.y &= leaves.y - 1u;
            if (kiln_test(ray, triangles, leaves.x + bit, found) && any && kiln_ends(found))
                return;
        }
        if (group.y <= 0x00ffffffu) {
            if (depth == 0u)
                return;
            group = stack[--depth];
        }
    }
}
