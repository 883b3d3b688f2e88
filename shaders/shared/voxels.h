/* Traversal of a voxel grid (worker/scene/voxels.h) along a line, in both languages: it visits the cells between two
 * places in order (Amanatides and Woo, "A Fast Voxel Traversal Algorithm for Ray Tracing", Eurographics 1987). Before
 * including it each language defines the grid:
 *
 *     KILN_VOXEL_GRID                    the type that its functions take
 *     KILN_VOXEL_LOW(grid)               corner of the first cell, m, a kiln_real3
 *     KILN_VOXEL_SCALE(grid)             cells a metre
 *     KILN_VOXEL_COUNT(grid, axis)       cells along x, y and z
 *     KILN_VOXEL_WORD(grid, i)           32 cells, a bit each: which of them count */
#ifndef KILN_SHADERS_SHARED_VOXELS_H
#define KILN_SHADERS_SHARED_VOXELS_H

#include "shaders/shared/mask.h"
#include "shaders/shared/real.h"

#define KILN_VOXEL_NEVER kiln_real_of(1.0e30f) /* parameter beyond the end of a line: no border */

/* State of a line along one axis: the line parameter (0 to 1) of the next cell border, and the distance between
 * borders. */
struct kiln_voxel_axis {
    kiln_real next, apart;
    KILN_U32 stride;
};

/* An end of a line, in units of cells: its place, the normal of its surface, its cell. */
struct kiln_voxel_end {
    kiln_real3 at, n;
    KILN_I32 x, y, z;
};

/* State of a line: its current cell, and the number of borders that are left to cross. */
struct kiln_voxel_line {
    KILN_STRUCT kiln_voxel_axis x, y, z;
    KILN_U32 at;
    KILN_I32 left;
};

KILN_FUNCTION KILN_I32 kiln_voxel_clamped(kiln_real x, KILN_I32 n)
{
    return x < kiln_real_of(0) ? 0 : x >= kiln_real_of(n) ? n - 1 : KILN_TO_I32(x);
}

KILN_FUNCTION KILN_I32 kiln_voxel_apart(KILN_I32 a, KILN_I32 b) { return a < b ? b - a : a - b; }

KILN_FUNCTION KILN_U32 kiln_voxel_index(KILN_VOXEL_GRID grid, KILN_I32 x, KILN_I32 y, KILN_I32 z)
{
    return KILN_TO_U32((z * KILN_VOXEL_COUNT(grid, y) + y) * KILN_VOXEL_COUNT(grid, x) + x);
}

KILN_FUNCTION KILN_STRUCT kiln_voxel_end kiln_voxel_end_at(KILN_VOXEL_GRID grid, kiln_real3 place, kiln_real3 normal)
{
    KILN_STRUCT kiln_voxel_end end;
    end.at = real3_scale(real3_sub(place, KILN_VOXEL_LOW(grid)), KILN_VOXEL_SCALE(grid));
    end.n = normal;
    end.x = kiln_voxel_clamped(end.at.x, KILN_VOXEL_COUNT(grid, x));
    end.y = kiln_voxel_clamped(end.at.y, KILN_VOXEL_COUNT(grid, y));
    end.z = kiln_voxel_clamped(end.at.z, KILN_VOXEL_COUNT(grid, z));
    return end;
}

KILN_FUNCTION KILN_STRUCT kiln_voxel_axis kiln_voxel_axis_of(kiln_real from, kiln_real to, KILN_I32 cell, KILN_I32 end,
                                                             KILN_I32 stride)
{
    const kiln_real d = to - from;
    KILN_STRUCT kiln_voxel_axis axis;
    axis.next = KILN_VOXEL_NEVER;
    axis.apart = kiln_real_of(0);
    axis.stride = 0u;
    if (cell != end) {
        axis.next = (kiln_real_of(d > kiln_real_of(0) ? cell + 1 : cell) - from) / d;
        axis.apart = kiln_real_of(1) / real_abs(d);
        axis.stride = KILN_TO_U32(d > kiln_real_of(0) ? stride : -stride);
    }
    return axis;
}

KILN_FUNCTION KILN_STRUCT kiln_voxel_line kiln_voxel_line_of(KILN_VOXEL_GRID grid,
                                                             KILN_IN(KILN_STRUCT kiln_voxel_end) a,
                                                             KILN_IN(KILN_STRUCT kiln_voxel_end) b)
{
    const KILN_I32 nx = KILN_VOXEL_COUNT(grid, x), ny = KILN_VOXEL_COUNT(grid, y);
    KILN_STRUCT kiln_voxel_line line;
    line.at = kiln_voxel_index(grid, KILN_AT(a).x, KILN_AT(a).y, KILN_AT(a).z);
    line.left = kiln_voxel_apart(KILN_AT(a).x, KILN_AT(b).x) + kiln_voxel_apart(KILN_AT(a).y, KILN_AT(b).y) +
                kiln_voxel_apart(KILN_AT(a).z, KILN_AT(b).z);
    line.x = kiln_voxel_axis_of(KILN_AT(a).at.x, KILN_AT(b).at.x, KILN_AT(a).x, KILN_AT(b).x, 1);
    line.y = kiln_voxel_axis_of(KILN_AT(a).at.y, KILN_AT(b).at.y, KILN_AT(a).y, KILN_AT(b).y, nx);
    line.z = kiln_voxel_axis_of(KILN_AT(a).at.z, KILN_AT(b).at.z, KILN_AT(a).z, KILN_AT(b).z, nx * ny);
    return line;
}

/* Moves to the next cell; returns the axis of the step. */
KILN_FUNCTION KILN_I32 kiln_voxel_step(KILN_INOUT(KILN_STRUCT kiln_voxel_line) line)
{
    KILN_AT(line).left--;
    if (KILN_AT(line).x.next < KILN_AT(line).y.next && KILN_AT(line).x.next < KILN_AT(line).z.next) {
        KILN_AT(line).at += KILN_AT(line).x.stride;
        KILN_AT(line).x.next += KILN_AT(line).x.apart;
        return 0;
    }
    if (KILN_AT(line).y.next < KILN_AT(line).z.next) {
        KILN_AT(line).at += KILN_AT(line).y.stride;
        KILN_AT(line).y.next += KILN_AT(line).y.apart;
        return 1;
    }
    KILN_AT(line).at += KILN_AT(line).z.stride;
    KILN_AT(line).z.next += KILN_AT(line).z.apart;
    return 2;
}

/* Whether a cell's bit is set; false beyond the grid, where rounding may take a line. */
KILN_FUNCTION bool kiln_voxel_is_solid(KILN_VOXEL_GRID grid, KILN_U32 at)
{
    const KILN_U32 cells = KILN_TO_U32(KILN_VOXEL_COUNT(grid, x)) * KILN_TO_U32(KILN_VOXEL_COUNT(grid, y)) *
                           KILN_TO_U32(KILN_VOXEL_COUNT(grid, z));
    return at < cells && (KILN_VOXEL_WORD(grid, at / 32u) >> at % 32u & 1u) != 0u;
}

/* Whether the cell at `at` touches the end's cell, or the plane of the end's surface crosses it. */
KILN_FUNCTION bool kiln_voxel_is_of_end(KILN_VOXEL_GRID grid, KILN_U32 at, KILN_IN(KILN_STRUCT kiln_voxel_end) end)
{
    const KILN_U32 nx = KILN_TO_U32(KILN_VOXEL_COUNT(grid, x)), ny = KILN_TO_U32(KILN_VOXEL_COUNT(grid, y));
    const KILN_I32 x = KILN_TO_I32(at % nx), y = KILN_TO_I32(at / nx % ny), z = KILN_TO_I32(at / (nx * ny));
    const kiln_real half_cell = KILN_RATIO(1, 2);
    const kiln_real3 n = KILN_AT(end).n, from = KILN_AT(end).at;
    if (kiln_voxel_apart(x, KILN_AT(end).x) <= 1 && kiln_voxel_apart(y, KILN_AT(end).y) <= 1 &&
        kiln_voxel_apart(z, KILN_AT(end).z) <= 1)
        return true;
    const kiln_real off = n.x * (kiln_real_of(x) + half_cell - from.x) + n.y * (kiln_real_of(y) + half_cell - from.y) +
                          n.z * (kiln_real_of(z) + half_cell - from.z),
                    reach = KILN_RATIO(1, 1000000) + half_cell * real_abs(n.x) + half_cell * real_abs(n.y) +
                            half_cell * real_abs(n.z);
    return real_abs(off) <= reach;
}

/* Whether the line between two places crosses no solid cell except those of the places' own surfaces. The loop ends
 * after as many steps as there are borders between the two. */
KILN_FUNCTION bool kiln_voxel_lets_see(KILN_VOXEL_GRID grid, kiln_real3 from, kiln_real3 from_normal, kiln_real3 to,
                                       kiln_real3 to_normal)
{
    const KILN_STRUCT kiln_voxel_end a = kiln_voxel_end_at(grid, from, from_normal),
                                     b = kiln_voxel_end_at(grid, to, to_normal);
    KILN_STRUCT kiln_voxel_line line = kiln_voxel_line_of(grid, KILN_TO(a), KILN_TO(b));
    while (line.left > 0) {
        if (kiln_voxel_is_solid(grid, line.at) && !kiln_voxel_is_of_end(grid, line.at, KILN_TO(a)) &&
            !kiln_voxel_is_of_end(grid, line.at, KILN_TO(b)))
            return false;
        kiln_voxel_step(KILN_TO(line));
    }
    return true;
}

#endif
