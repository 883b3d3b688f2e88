/* Positions on surface points: kiln_footprint_sample and frame_position of the Embree backend. Needs trace.glsl before
 * it if DRAW_AGAIN may be 1. */

#include "shaders/material.glsl"
#include "shaders/shared/lift.h"
#include "shaders/shared/passage.h"
#include "shaders/shared/streams.h"
#include "shaders/shared/warp.h"

KILN_ARRAY(PointArray, kiln_gpu_point, 8);
KILN_ARRAY(PieceArray, kiln_gpu_piece, 8);
KILN_ARRAY(WordArray, uint, 4);

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
    float rest;
    uint n = kiln_mask_choose(s, mask.at[0].count, rest), word = 0u;
    uint bits = bitCount(mask.at[0].cells[0]);
    while (n >= bits && word + 1u < KILN_MASK_WORDS) {
        n -= bits;
        bits = bitCount(mask.at[0].cells[++word]);
    }
    const uint cell = 32u * word + kiln_set_bit(mask.at[0].cells[word], n);
    s = kiln_mask_s(cell, rest);
    t = kiln_mask_t(cell, t);
}

/* A part of a point, and a position in it: p + w1 e1 + w2 e2. A whole point is a single part with w1, w2 = s, t. */
struct kiln_piece_place {
    uint part;
    float w1, w2;
};

kiln_piece_place kiln_find_piece(kiln_gpu_point p, uint64_t parts, float s, float t)
{
    if ((p.flags & KILN_GPU_POINT_PARTIAL) == 0u)
        return kiln_piece_place(0u, s, t);
    PieceArray all = PieceArray(parts + uint64_t(p.first_piece) * 56ul);
    uint low = 0u, high = p.part_count - 1u;
    while (low < high) {
        const uint middle = low + (high - low) / 2u;
        if (all.at[middle].until > s)
            high = middle;
        else
            low = middle + 1u;
    }
    const float before = low > 0u ? all.at[low - 1u].until : 0.0, width = all.at[low].until - before;
    const float root = sqrt(width > 0.0 ? clamp((s - before) / width, 0.0, 1.0) : 0.5), w2 = root * t;
    return kiln_piece_place(low, root - w2, w2);
}

KILN_ARRAY(PieceTriangleArray, kiln_gpu_piece_triangle, 4);

/* kiln_footprint_sample_present of worker/scene/footprint.h. */
kiln_piece_place kiln_find_present(kiln_gpu_point p, uint64_t parts, float s, float t)
{
    const uint64_t mask = parts + (uint64_t(p.first_piece) + p.part_count) * 56ul;
    PieceTriangleArray triangles = PieceTriangleArray(mask + 56ul);
    const float most = MaskArray(mask).at[0].most;
    float u = s, v = t;
    kiln_piece_place place;
    for (uint i = 0u; i < KILN_PLACE_TRIES; i++) {
        const uint hash = kiln_place_try(s, t, p.key, i);
        kiln_mask_place(mask, u, v);
        place = kiln_find_piece(p, parts, u, v);
        const kiln_gpu_piece_triangle of = triangles.at[place.part];
        const float b1 = of.weight[0] + place.w1 * of.along_e1[0] + place.w2 * of.along_e2[0],
                    b2 = of.weight[1] + place.w1 * of.along_e1[1] + place.w2 * of.along_e2[1];
        const float opacity =
            of.triangle < SCENE.opaque_count ? 1.0 : kiln_surface_passage(of.triangle, b1, b2).opacity;
        if (kiln_is_there(hash, of.triangle, opacity / most))
            break;
        u = kiln_unit_float(hash);
        v = kiln_unit_float(kiln_hash1(hash));
    }
    return place;
}

/* Position on the point for s and t in (0, 1): position with offset, geometric normal, and the offset. Returns the
 * part. */
kiln_piece_place kiln_place(kiln_gpu_point p, uint64_t parts, float s, float t, out vec3 position, out vec3 normal,
                           out float offset)
{
    kiln_piece_place place;
    if (HAS_ALPHA != 0u && (p.flags & KILN_GPU_POINT_MASKED) != 0u)
        place = kiln_find_present(p, parts, s, t);
    else
        place = kiln_find_piece(p, parts, s, t);
    if ((p.flags & KILN_GPU_POINT_PARTIAL) == 0u) {
        position = p.origin + place.w1 * p.edge_s + place.w2 * p.edge_t;
        normal = p.normal;
        offset = p.offset;
        return place;
    }
    const kiln_gpu_piece part = PieceArray(parts + uint64_t(p.first_piece) * 56ul).at[place.part];
    position = part.p + place.w1 * part.e1 + place.w2 * part.e2;
    normal = part.normal;
    offset = part.offset;
    return place;
}

#ifdef KILN_TRACES
bool kiln_meets_back(vec3 position, vec3 direction, uint preferred)
{
    const kiln_hit hit = kiln_trace(position, direction, KILN_ENDLESS, preferred);
    if (hit.triangle == KILN_GPU_NONE || !hit.back)
        return false;
    return (floatBitsToUint(RecordHalves(SCENE.records + uint64_t(hit.triangle) * 32ul).at[1].w) &
            (KILN_RECORD_DOUBLE_SIDED | KILN_RECORD_CLEAR)) == 0u;
}

/* Whether a position is buried: a ray along the normal and three rays at 53 degrees to it all hit backs of single-sided
 * surfaces other than glass. That is tested first. Then, for validity, whether at most KILN_BURIED_BOTH of these hits
 * coincide with fronts. */
bool kiln_buried(vec3 position, vec3 normal)
{
    vec3 t, b;
    int both = 0;
    kiln_basis(normal, t, b);
    for (int k = 0; k < (KILN_ASKS_BURIED ? 8 : 4); k++) {
        const int i = k & 3;
        const vec2 turn = i == 0   ? vec2(0.0)
                          : i == 1 ? vec2(KILN_BURIED_ACROSS, 0.0)
                                   : vec2(-KILN_BURIED_HALF, i == 2 ? KILN_BURIED_SIDE : -KILN_BURIED_SIDE);
        const vec3 direction = i == 0 ? normal : turn.x * t + turn.y * b + KILN_BURIED_ALONG * normal;
        const uint preferred = !KILN_ASKS_BURIED ? KILN_EITHER : k < 4 ? KILN_BACK : KILN_FRONT;
        if (!kiln_meets_back(position, direction, preferred)) {
            both++;
            if (k < 4 || both > KILN_BURIED_BOTH)
                return false;
        }
    }
    return true;
}

/* Height by which rays are lifted off the part, at a position of a lifted point. */
float kiln_part_lift(kiln_gpu_point p, uint64_t parts, kiln_piece_place place)
{
    const uint before = p.part_count + ((p.flags & KILN_GPU_POINT_MASKED) != 0u ? 1u : 0u);
    const kiln_gpu_piece_triangle of =
        PieceTriangleArray(parts + (uint64_t(p.first_piece) + before) * 56ul).at[place.part];
    return kiln_lift_at(kiln_lift(of.lift), of.weight[0] + place.w1 * of.along_e1[0] + place.w2 * of.along_e2[0],
                        of.weight[1] + place.w1 * of.along_e1[1] + place.w2 * of.along_e2[1]);
}

/* Lifts a position, but not through a surface above it. */
void kiln_lift_position(kiln_gpu_point p, uint64_t parts, kiln_piece_place place, vec3 normal, inout vec3 position,
                        inout float offset)
{
    float lift = kiln_part_lift(p, parts, place);
    if (!(lift > 0.0))
        return;
    const kiln_hit above = kiln_trace(position, normal, lift / KILN_LIFT_CLEAR, KILN_EITHER);
    if (above.triangle != KILN_GPU_NONE)
        lift = KILN_LIFT_CLEAR * above.distance;
    position += lift * normal;
    offset += lift;
}

/* Whether light from a direction reaches the point without being blocked by its own surface: frame_faces. */
bool kiln_faces(kiln_gpu_point p, float cosine, float shading_cosine)
{
    return (HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_LIFTED) != 0u ? shading_cosine : cosine) > 0.0;
}

/* kiln_place with lifting. Where DRAW_AGAIN says so (only for points in the state KILN_GPU_STATE_BURIED), buried
 * positions are drawn again. */
void kiln_position(kiln_gpu_point p, uint64_t parts, float s, float t, out vec3 position, out vec3 normal,
                   out float offset)
{
    float u = s, v = t;
    bool again = true;
    for (uint i = 0u; again; i++) {
        const kiln_piece_place place = kiln_place(p, parts, u, v, position, normal, offset);
        if (HAS_SMOOTH != 0u && (p.flags & KILN_GPU_POINT_LIFTED) != 0u)
            kiln_lift_position(p, parts, place, normal, position, offset);
        again = DRAW_AGAIN != 0u && i < KILN_BURIED_TRIES && kiln_buried(position, normal);
        const uint hash = kiln_buried_retry(s, t, p.key, i);
        u = kiln_unit_float(hash);
        v = kiln_unit_float(kiln_hash1(hash));
    }
}
#endif

/* Index of thread x's point among the block's points; KILN_GPU_NONE if it has none. With DRAW_AGAIN the list contains
 * partly buried points, otherwise all points that are entirely valid. */
uint kiln_point_of_thread(kiln_gpu_chunk chunk, uint x)
{
    if (x >= chunk.count)
        return KILN_GPU_NONE;
    const uint index = chunk.list != 0ul ? WordArray(chunk.list).at[chunk.first + x] : chunk.first + x;
    const uint wanted = DRAW_AGAIN != 0u ? KILN_GPU_STATE_BURIED : KILN_GPU_STATE_VALID;
    return (WordArray(chunk.states).at[index] & KILN_GPU_STATE_MASK) == wanted ? index : KILN_GPU_NONE;
}
