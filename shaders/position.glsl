/* Positions on surface points: as kiln_footprint_sample and frame_position of the other backend. Needs trace.glsl
 * before it where DRAW_AGAIN may be 1. */

KILN_ARRAY(PointArray, kiln_gpu_point, 8);
KILN_ARRAY(PartArray, kiln_gpu_part, 8);
KILN_ARRAY(WordArray, uint, 4);

/* Centre of the 2^-23 interval of a 32-bit fraction: exact, strictly inside (0, 1). */
float kiln_unit_float(uint fraction) { return (float(fraction >> 9) + 0.5) * (1.0 / 8388608.0); }

/* Orthonormal tangents of unit n (Duff et al., "Building an Orthonormal Basis, Revisited", JCGT 2017). */
void kiln_basis(vec3 n, out vec3 t, out vec3 b)
{
    const float side = n.z < 0.0 || (n.z == 0.0 && floatBitsToUint(n.z) != 0u) ? -1.0 : 1.0; /* copysign: -0 counts */
    const float a = -1.0 / (side + n.z), c = n.x * n.y * a;
    t = vec3(1.0 + side * n.x * n.x * a, side * c, -side * n.x);
    b = vec3(c, side + n.y * n.y * a, -n.y);
}

/* The shading normal of a sample whose geometric normal is n: as frame_shading. */
vec3 kiln_shading(kiln_gpu_point p, vec3 n)
{
    const bool smooth_point = HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_SMOOTH) != 0u;
    return smooth_point && dot(p.shading, n) > 0.0 ? p.shading : n;
}

KILN_ARRAY(MaskArray, kiln_gpu_mask, 4);

/* kiln_mask_place of worker/scene/footprint.h. */
void kiln_mask_place(uint64_t address, inout float s, inout float t)
{
    MaskArray mask = MaskArray(address);
    const uint count = mask.at[0].count;
    const float scaled = s * float(count);
    uint n = min(uint(scaled), count - 1u), word = 0u;
    const float rest = min(scaled - float(n), 0.999999940395355224609375);
    uint bits = bitCount(mask.at[0].cells[0]);
    while (n >= bits && word + 1u < KILN_MASK_WORDS) {
        n -= bits;
        bits = bitCount(mask.at[0].cells[++word]);
    }
    const uint cell = 32u * word + kiln_set_bit(mask.at[0].cells[word], n);
    s = (float(kiln_cell_column(cell)) + rest) / float(KILN_MASK_SIDE);
    t = (float(kiln_cell_column(cell >> 1)) + t) / float(KILN_MASK_SIDE);
}

/* A place on the point for s and t in (0, 1): position with its offset, geometric normal, and that offset. */
void kiln_place(kiln_gpu_point p, uint64_t parts, float s, float t, out vec3 position, out vec3 normal,
                out float offset)
{
    if (HAS_ALPHA != 0u && (p.flags & KILN_GPU_POINT_MASKED) != 0u)
        kiln_mask_place(parts + (uint64_t(p.first_part) + p.part_count) * 56ul, s, t);
    if ((p.flags & KILN_GPU_POINT_PARTIAL) == 0u) {
        position = p.origin + s * p.edge_s + t * p.edge_t;
        normal = p.normal;
        offset = p.offset;
        return;
    }
    PartArray all = PartArray(parts + uint64_t(p.first_part) * 56ul);
    uint low = 0u, high = p.part_count - 1u;
    while (low < high) {
        const uint middle = low + (high - low) / 2u;
        if (all.at[middle].until > s)
            high = middle;
        else
            low = middle + 1u;
    }
    const float before = low > 0u ? all.at[low - 1u].until : 0.0;
    const kiln_gpu_part part = all.at[low];
    const float width = part.until - before;
    const float root = sqrt(width > 0.0 ? clamp((s - before) / width, 0.0, 1.0) : 0.5), w2 = root * t, w1 = root - w2;
    position = part.p + w1 * part.e1 + w2 * part.e2;
    normal = part.normal;
    offset = part.offset;
}

#ifdef KILN_TRACES
bool kiln_meets_back(vec3 position, vec3 direction)
{
    const kiln_hit hit = kiln_trace(position, direction);
    if (hit.triangle == KILN_GPU_NONE || !hit.back)
        return false;
    return (floatBitsToUint(RecordHalves(SCENE.records + uint64_t(hit.triangle) * 32ul).at[1].w) & KILN_DOUBLE_SIDED) ==
           0u;
}

/* A ray along the normal and three around it, 53 degrees off, all meet backs of single-sided surfaces. */
bool kiln_buried(vec3 position, vec3 normal)
{
    vec3 t, b;
    kiln_basis(normal, t, b);
    for (int i = 0; i < 4; i++) {
        const vec2 turn = i == 0 ? vec2(0.0) : i == 1 ? vec2(0.8, 0.0) : vec2(-0.4, i == 2 ? 0.6928 : -0.6928);
        const vec3 direction = i == 0 ? normal : turn.x * t + turn.y * b + 0.6 * normal;
        if (!kiln_meets_back(position, direction))
            return false;
    }
    return true;
}

/* kiln_place, drawn again while it is buried where DRAW_AGAIN says so (for points in the state KILN_GPU_STATE_BURIED
 * only). */
void kiln_position(kiln_gpu_point p, uint64_t parts, float s, float t, out vec3 position, out vec3 normal,
                   out float offset)
{
    kiln_place(p, parts, s, t, position, normal, offset);
    if (DRAW_AGAIN == 0u)
        return;
    const uint tries = 32u;
    for (uint i = 0u; i < tries && kiln_buried(position, normal); i++) {
        const uint hash = kiln_hash2(kiln_hash2(uint(s * 16777216.0), uint(t * 16777216.0)), p.key + i);
        kiln_place(p, parts, kiln_unit_float(hash), kiln_unit_float(kiln_hash1(hash)), position, normal, offset);
    }
}
#endif

/* The chunk's point of thread x: its index among the block's points, or KILN_GPU_NONE when thread x has none. With
 * DRAW_AGAIN the list names partly buried points; without, all points that are valid as a whole. */
uint kiln_point_of_thread(kiln_gpu_chunk chunk, uint x)
{
    if (x >= chunk.count)
        return KILN_GPU_NONE;
    const uint index = chunk.list != 0ul ? WordArray(chunk.list).at[chunk.first + x] : chunk.first + x;
    const uint wanted = DRAW_AGAIN != 0u ? KILN_GPU_STATE_BURIED : KILN_GPU_STATE_VALID;
    return WordArray(chunk.states).at[index] == wanted ? index : KILN_GPU_NONE;
}
