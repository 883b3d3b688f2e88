/* Neighbours of surface points: the points of the same surface near a point, in space and not on the layout, so that
 * chart borders do not matter.
 *
 * Lengths around a point are measured in its texels: its `size` is the side of its texel, m. Point j is a neighbour of
 * point i if
 *   - it lies within `radius` texels of i,
 *   - the cosine of the angle between their normals is at least KILN_NEIGHBOUR_COSINE,
 *   - it lies in the tangent plane of i, but for a twentieth of a texel or 0.6 d sin(angle),
 *     where a circle leaves it by 0.5 d sin(angle) within a small distance d,
 *   - its texel is less than four times as large or small as that of i.
 * So a surface's two sides, the two faces at an edge, and two faces that are parallel and a tenth of a texel apart are
 * not neighbours.
 *
 * Points are sorted into the cells of grids, one for each power of two of the texel's size. All points of a cell share
 * one list of candidates. Not collective. The result depends on the points only. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_DENOISE_NEIGHBOURS_H
#define KILN_COORDINATOR_OUTPUT_MAP_DENOISE_NEIGHBOURS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "worker/base/arena.h"
#include "worker/base/status.h"
#include "worker/pass/regression.h"

/* Limits of the search: KILN_NEIGHBOUR_RADIUS, largest radius, texels; KILN_NEIGHBOUR_COSINE. */

struct kiln_neighbour_point {
    float position[3]; /* m */
    float normal[3];   /* unit */
    float area;        /* m2 */
    float size;        /* m, above 0 */
    uint32_t order;    /* unique; sorts the points of a cell */
    uint32_t index;    /* caller's index of the point's values */
};

/* Side of a cell, in the smallest texels that it may contain; largest number of a cell along an axis. */
enum { KILN_NEIGHBOUR_CELL = 8, KILN_NEIGHBOUR_FARTHEST = 1 << 30 };

/* Level of a grid: exponent of the largest power of two not above the texel's size, which must be a normal number. */
static inline int kiln_neighbour_level(float size)
{
    uint32_t bits;
    memcpy(&bits, &size, sizeof bits);
    return (int)(bits >> 23 & 0xffu) - 127;
}

/* Cells per metre: 2^-level / KILN_NEIGHBOUR_CELL, for levels from -200 to 200. */
static inline double kiln_neighbour_scale(int level)
{
    const uint64_t bits = (uint64_t)(1023 - 3 - level) << 52;
    double scale;
    memcpy(&scale, &bits, sizeof scale);
    return scale;
}
_Static_assert(KILN_NEIGHBOUR_CELL == 1 << 3, "the scale of cells");

/* Number of the cell along an axis, rounded down. */
static inline int32_t kiln_neighbour_along(float position, double scale)
{
    const double at = (double)position * scale, low = at > -KILN_NEIGHBOUR_FARTHEST ? at : -KILN_NEIGHBOUR_FARTHEST,
                 within = low < KILN_NEIGHBOUR_FARTHEST ? low : KILN_NEIGHBOUR_FARTHEST;
    const int32_t whole = (int32_t)within;
    return whole - (within < whole);
}

/* Grid of a surface's points. Cell c has the places [first[c], first[c + 1]). */
struct kiln_neighbour_grid {
    size_t count, cell_count;
    struct kiln_neighbour_point *points; /* sorted */
    uint32_t *first;                     /* first place of each cell, and the end */
    struct kiln_neighbour_cell *cells;   /* private, as the levels are */
    struct kiln_neighbour_level *levels; /* ascending */
    size_t level_count;
    struct kiln_arena arena;
};

/* Sorts the points: at least one, and less than 2^32 - 1. *points (of kiln_allocate) then belongs to the grid and
 * becomes NULL, even on failure: KILN_SYSTEM. */
int kiln_neighbour_grid_create(struct kiln_neighbour_grid **grid, struct kiln_neighbour_point **points, size_t count,
                               struct kiln_error *error);
void kiln_neighbour_grid_destroy(struct kiln_neighbour_grid **grid);

/* Input of a device: the cell of each place, and the candidates of each cell within KILN_NEIGHBOUR_RADIUS, as ascending
 * ranges of places [begin, end). These may contain more places than kiln_neighbours_collect finds, but no more
 * neighbours: they are whole cells or, for cells with more than KILN_NEIGHBOURS_MOST_TWICE candidates, its exact
 * result. */
struct kiln_neighbour_ranges {
    uint32_t *cells; /* of each place */
    uint32_t *first; /* first range of each cell, and the end */
    uint32_t (*ranges)[2];
    struct kiln_arena arena;
};
/* Lists the ranges. KILN_SYSTEM. Release them in either case. */
int kiln_neighbour_ranges_list(struct kiln_neighbour_ranges *ranges, const struct kiln_neighbour_grid *grid,
                               struct kiln_error *error);
void kiln_neighbour_ranges_release(struct kiln_neighbour_ranges *ranges);

/* Largest number of candidates of a cell. If there are more, on a surface folded upon itself many times, every second,
 * third ... is dropped. */
enum { KILN_NEIGHBOURS_MOST = 4096, KILN_NEIGHBOURS_MOST_TWICE = 2 * KILN_NEIGHBOURS_MOST, KILN_NEIGHBOUR_RINGS = 6 };

/* Length of the candidate arrays: not a multiple of a page, so that entries of one index do not compete for one cache
 * set. */
enum { KILN_NEIGHBOURS_ROOM = KILN_NEIGHBOURS_MOST + 80 };

/* Most numbers that are kept of a cell's neighbours: a flat surface has up to 64 points of 207 numbers each in it. */
enum { KILN_NEIGHBOURS_FOUND = 1 << 16 };

/* Outer radius of each ring, texels. */
extern const float kiln_neighbour_rings[KILN_NEIGHBOUR_RINGS];

/* Working data of one thread. `place`, `x`, `y` and `area` describe the neighbours of one point, inner rings first,
 * without the point itself. x and y are in its tangent plane, in texels. */
struct kiln_neighbours {
    size_t within[KILN_NEIGHBOUR_RINGS]; /* number of neighbours within each ring's radius */
    uint32_t place[KILN_NEIGHBOURS_ROOM];
    float x[KILN_NEIGHBOURS_ROOM], y[KILN_NEIGHBOURS_ROOM], area[KILN_NEIGHBOURS_ROOM];
    size_t candidates;
    uint32_t candidate[KILN_NEIGHBOURS_ROOM];
    struct {
        float position[3][KILN_NEIGHBOURS_ROOM], normal[3][KILN_NEIGHBOURS_ROOM], area[KILN_NEIGHBOURS_ROOM];
    } of;                                /* the candidates */
    int32_t ring[KILN_NEIGHBOURS_ROOM];  /* of the candidates */
    uint32_t near[KILN_NEIGHBOURS_ROOM]; /* candidates that are neighbours */
    float square[KILN_NEIGHBOURS_ROOM];  /* of the neighbours' distances, texels */
    bool thinned;                        /* some candidates were dropped */
    /* Lists of the neighbours of the cell's places, one after another: numbers within each ring, then candidates. */
    const uint16_t *kept; /* the next place's list; NULL: its neighbours are searched */
    size_t found_count;
    uint16_t found[KILN_NEIGHBOURS_FOUND]; /* lists of the places that were searched */
    bool full;                             /* they did not fit in there */
};

/* Neighbours of a grid's points that are kept from the first sweep for later ones, cell by cell. All zero: none. */
struct kiln_neighbours_kept {
    uint16_t **cells; /* lists of each cell's places; NULL: not kept */
    size_t cell_count;
    size_t left; /* bytes that may still be kept */
};

/* Prepares to keep the neighbours of a grid's points, in at most `most` bytes. KILN_SYSTEM. Release it in either
 * case. */
int kiln_neighbours_kept_create(struct kiln_neighbours_kept *kept, const struct kiln_neighbour_grid *grid, size_t most,
                                struct kiln_error *error);
void kiln_neighbours_kept_release(struct kiln_neighbours_kept *kept);

/* Collects the candidates of a cell, for neighbours within `radius` texels. */
void kiln_neighbours_collect(struct kiln_neighbours *n, const struct kiln_neighbour_grid *grid, size_t cell,
                             float radius);
/* Likewise, but the neighbours that were kept need not be searched: kiln_neighbours_find must then be called for all
 * places of the cell, in order. */
void kiln_neighbours_collect_kept(struct kiln_neighbours *n, const struct kiln_neighbour_grid *grid,
                                  const struct kiln_neighbours_kept *kept, size_t cell, float radius);
/* Finds the neighbours of the point at `place`, in the cell collected last, within at most that radius. */
void kiln_neighbours_find(struct kiln_neighbours *n, const struct kiln_neighbour_grid *grid, size_t place,
                          float radius);
/* Keeps the neighbours within KILN_NEIGHBOUR_RADIUS of all places of the cell collected last, which have just been
 * found in order, if there is room for them. Several threads may keep cells at once. */
void kiln_neighbours_keep(const struct kiln_neighbours *n, struct kiln_neighbours_kept *kept, size_t cell);

#endif
