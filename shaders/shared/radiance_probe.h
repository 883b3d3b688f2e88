/* Radiance probes that answer gather rays which end at the tracing range (worker/scene/radiance_probes.h): their grid,
 * which of them a ray asks, in which direction, and which element of a map that is. The same in C and GLSL.
 *
 * A map is a square, for octahedral maps, or six, for cube maps, of side x side elements. A place of a map is a point
 * of an octahedron or a cube about the probe; its direction is the point's. A map's squares unfold without stretching,
 * so an area of the map at the point p stands for a solid angle that is proportional to 1 / |p|^3. */
#ifndef KILN_SHADERS_SHARED_RADIANCE_PROBE_H
#define KILN_SHADERS_SHARED_RADIANCE_PROBE_H

#include "shaders/shared/language.h"

/* Bases of a probe's radiance: coefficients of spherical harmonics (shaders/shared/harmonics.h), or the radiance of
 * each element of a map; three floats each. The rays of harmonics are spread over an octahedral map. */
#define KILN_PROBE_HARMONICS 0u
#define KILN_PROBE_OCTAHEDRAL 1u
#define KILN_PROBE_CUBE 2u

/* A surface point's word about the probes near it: the cell of the grid that it lies in, by the number of the cell's
 * first corner, above KILN_PROBE_CORNERS bits that say which of the cell's corners have a probe that the point sees.
 * Bit c is the corner one step up x where c & 1, y where c & 2, z where c & 4. */
#define KILN_PROBE_CORNERS 8u
#define KILN_PROBE_SEEN 0xffu

struct kiln_probe_grid {
    KILN_VECTOR origin;    /* of probe (0, 0, 0), m from the scene's centre */
    float spacing;         /* m */
    KILN_U32 size[3];      /* probe (x, y, z) has the number (z * size[1] + y) * size[0] + x */
    KILN_U32 basis;        /* KILN_PROBE_HARMONICS, ... */
    KILN_U32 side;         /* elements along a side of the map that rays are spread over */
    KILN_U32 floats;       /* of a probe */
    float range;           /* m: gather rays end there */
    float projection;      /* m along a ray, of the place towards which its probe looks; 0: where it leaves the box */
    KILN_VECTOR low, high; /* the scene's box, m from its centre */
};

KILN_FUNCTION KILN_U32 kiln_probe_elements(KILN_U32 basis, KILN_U32 side)
{
    return basis == KILN_PROBE_CUBE ? 6u * side * side : side * side;
}

/* ---- maps ---- */

/* -1 below 0, else 1. */
KILN_FUNCTION float kiln_probe_sign(float x) { return x < 0.0f ? -1.0f : 1.0f; }

/* The point of the octahedron |x| + |y| + |z| = 1 at (u, v) of its map, both from -1 to 1. */
KILN_FUNCTION KILN_VECTOR kiln_octahedron_point(float u, float v)
{
    const float z = 1.0f - float_abs(u) - float_abs(v);
    if (z >= 0.0f)
        return vec3(u, v, z);
    return vec3((1.0f - float_abs(v)) * kiln_probe_sign(u), (1.0f - float_abs(u)) * kiln_probe_sign(v), z);
}

/* The point at (u, v) of a face of the cube max(|x|, |y|, |z|) = 1; faces +x -x +y -y +z -z. */
KILN_FUNCTION KILN_VECTOR kiln_cube_point(KILN_U32 face, float u, float v)
{
    const float along = (face & 1u) == 0u ? 1.0f : -1.0f;
    if (face < 2u)
        return vec3(along, u, v);
    if (face < 4u)
        return vec3(u, along, v);
    return vec3(u, v, along);
}

/* The point at the place (s, t), both from 0 to 1, of an element. */
KILN_FUNCTION KILN_VECTOR kiln_probe_point(KILN_U32 basis, KILN_U32 side, KILN_U32 element, float s, float t)
{
    const KILN_U32 square = element % (side * side);
    const float scale = 2.0f / KILN_TO_F32(side);
    const float u = (KILN_TO_F32(square % side) + s) * scale - 1.0f;
    const float v = (KILN_TO_F32(square / side) + t) * scale - 1.0f;
    if (basis == KILN_PROBE_CUBE)
        return kiln_cube_point(element / (side * side), u, v);
    return kiln_octahedron_point(u, v);
}

/* The column or row at u, from -1 to 1. */
KILN_FUNCTION KILN_U32 kiln_probe_column(float u, KILN_U32 side)
{
    return word_min(KILN_TO_U32(float_max((0.5f * u + 0.5f) * KILN_TO_F32(side), 0.0f)), side - 1u);
}

/* The element that direction d, of any length above 0, points at. */
KILN_FUNCTION KILN_U32 kiln_octahedron_element(KILN_U32 side, KILN_VECTOR d)
{
    const float scale = 1.0f / (float_abs(d.x) + float_abs(d.y) + float_abs(d.z));
    const float x = d.x * scale, y = d.y * scale;
    const float u = d.z >= 0.0f ? x : (1.0f - float_abs(y)) * kiln_probe_sign(x);
    const float v = d.z >= 0.0f ? y : (1.0f - float_abs(x)) * kiln_probe_sign(y);
    return kiln_probe_column(v, side) * side + kiln_probe_column(u, side);
}
KILN_FUNCTION KILN_U32 kiln_cube_element(KILN_U32 side, KILN_VECTOR d)
{
    const float x = float_abs(d.x), y = float_abs(d.y), z = float_abs(d.z);
    KILN_U32 face = d.x >= 0.0f ? 0u : 1u;
    float u = d.y / x, v = d.z / x;
    if (y > x && y >= z) {
        face = d.y >= 0.0f ? 2u : 3u;
        u = d.x / y;
        v = d.z / y;
    } else if (z > x) {
        face = d.z >= 0.0f ? 4u : 5u;
        u = d.x / z;
        v = d.y / z;
    }
    return (face * side + kiln_probe_column(v, side)) * side + kiln_probe_column(u, side);
}
KILN_FUNCTION KILN_U32 kiln_probe_element(KILN_U32 basis, KILN_U32 side, KILN_VECTOR d)
{
    return basis == KILN_PROBE_CUBE ? kiln_cube_element(side, d) : kiln_octahedron_element(side, d);
}

/* ---- which probe a ray asks ---- */

/* How far along its cell a place is, 0 to 1. */
KILN_FUNCTION float kiln_probe_fraction(float place, float origin, float spacing, KILN_U32 cell)
{
    return float_min(float_max((place - origin) / spacing - KILN_TO_F32(cell), 0.0f), 1.0f);
}

/* Trilinear weight of a corner; a little more, so that one alone has some everywhere. */
KILN_FUNCTION float kiln_probe_weight(KILN_U32 corner, KILN_VECTOR f)
{
    const float x = (corner & 1u) != 0u ? f.x : 1.0f - f.x;
    const float y = (corner & 2u) != 0u ? f.y : 1.0f - f.y;
    const float z = (corner & 4u) != 0u ? f.z : 1.0f - f.z;
    return x * y * z + 1.0e-4f;
}

/* One of the corners that `seen` names (at least one), by their weights at the place f of the cell and the random
 * number u in (0, 1). */
KILN_FUNCTION KILN_U32 kiln_probe_choose(KILN_U32 seen, KILN_VECTOR f, float u)
{
    float left = 0.0f;
    for (KILN_U32 c = 0u; c < KILN_PROBE_CORNERS; c++)
        left += (seen >> c & 1u) != 0u ? kiln_probe_weight(c, f) : 0.0f;
    left *= u;
    KILN_U32 chosen = 0u;
    bool found = false;
    for (KILN_U32 c = 0u; c < KILN_PROBE_CORNERS; c++) {
        if ((seen >> c & 1u) == 0u || found)
            continue;
        chosen = c;
        left -= kiln_probe_weight(c, f);
        found = left < 0.0f;
    }
    return chosen;
}

/* Distance at which a ray leaves a slab. */
KILN_FUNCTION float kiln_probe_leave(float at, float direction, float low, float high)
{
    if (direction == 0.0f)
        return 3.0e38f;
    return float_max(((direction > 0.0f ? high : low) - at) / direction, 0.0f);
}

/* Distance at which a ray from `at` leaves the scene's box: nothing is behind. */
KILN_FUNCTION float kiln_probe_far(KILN_STRUCT kiln_probe_grid grid, KILN_VECTOR at, KILN_VECTOR d)
{
    const float x = kiln_probe_leave(at.x, d.x, grid.low.x, grid.high.x);
    const float y = kiln_probe_leave(at.y, d.y, grid.low.y, grid.high.y);
    const float z = kiln_probe_leave(at.z, d.z, grid.low.z, grid.high.z);
    return float_min(x, float_min(y, z));
}

/* Where a probe is to look for a ray from `at` with direction d that leaves the box at `far`: from the probe towards
 * that place, or towards one at a fixed distance along the ray; not of unit length. */
KILN_FUNCTION KILN_VECTOR kiln_probe_direction(KILN_STRUCT kiln_probe_grid grid, KILN_VECTOR at, KILN_VECTOR d,
                                               float far, KILN_VECTOR probe)
{
    const float along = grid.projection > 0.0f ? grid.projection : far;
    const KILN_VECTOR to =
        vec3(at.x - probe.x + along * d.x, at.y - probe.y + along * d.y, at.z - probe.z + along * d.z);
    const bool is_none = !(to.x * to.x + to.y * to.y + to.z * to.z > 0.0f);
    return is_none ? d : to;
}

/* The cell that a place lies in, along one axis; the nearest one outside of the grid. */
KILN_FUNCTION KILN_U32 kiln_probe_cell_along(float at, float origin, float spacing, KILN_U32 size)
{
    const float last = KILN_TO_F32(size > 1u ? size - 2u : 0u);
    return KILN_TO_U32(float_min(float_max((at - origin) / spacing, 0.0f), last));
}

/* The corners that a cell has: where the grid is one probe thick, the first ones. */
KILN_FUNCTION KILN_U32 kiln_probe_corners(KILN_STRUCT kiln_probe_grid grid)
{
    return KILN_PROBE_SEEN & (grid.size[0] > 1u ? 0xffu : 0x55u) & (grid.size[1] > 1u ? 0xffu : 0x33u) &
           (grid.size[2] > 1u ? 0xffu : 0x0fu);
}

/* A ray's end, in ranges: a little before the range, so that what begins there is on this side of a wall that the ray
 * has all but met. */
#define KILN_PROBE_END 0.999f
/* Nothing may stand nearer behind a probe that is seen, in spacings: else from the other side of a thin wall the probe
 * would seem to be on this side of it. */
#define KILN_PROBE_CLEAR 1.0e-3f
/* x of the position of a probe that is off. */
#define KILN_PROBE_OFF 3.0e38f

#endif
