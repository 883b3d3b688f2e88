/* The cells of a texel: what lines, along which walls stand on it, cut it into; and the parts that these come to
 * (struct kiln_divided_texel of worker/scene/surface.h). Geometry alone: who asks rays joins the cells. Pure. */
#ifndef KILN_COORDINATOR_BAKE_POINTS_TEXEL_CELLS_H
#define KILN_COORDINATOR_BAKE_POINTS_TEXEL_CELLS_H

#include "worker/scene/footprint.h"

enum { KILN_CELLS_MOST = 1 << KILN_CUT_LINES, KILN_CELL_PLACES = 5 };

/* Pieces of a texel that its cells are cut from. Borrowed. */
struct kiln_texel_pieces {
    const struct kiln_scene *scene;
    const struct kiln_geometry *geometry;
    const uint32_t *triangles;
    uint32_t count;
    const struct kiln_texel_place *place;
};

/* A convex cell that has some of the surface. */
struct kiln_texel_cell {
    uint32_t code;                     /* as in shaders/shared/divided.h */
    uint32_t joined;                   /* index of the first cell that it is joined with, or its own */
    bool buried;                       /* it lies inside of a solid */
    double area;                       /* m2 */
    double centre[2];                  /* a place in it, in the texel's square */
    double place[KILN_CELL_PLACES][2]; /* others, near the corners of its largest piece */
};

struct kiln_texel_cells {
    float lines[KILN_CUT_FLOATS];
    uint32_t line_count, count;
    struct kiln_texel_cell cell[KILN_CELLS_MOST]; /* in order of their codes */
};

/* Adds a line a x + b y = c in the texel's square, unless it has it already, or KILN_CUT_LINES others. */
void kiln_texel_cells_add_line(struct kiln_texel_cells *cells, double a, double b, double c);

/* Cuts the texel along the lines. Leaves out lines that cut nothing off. */
void kiln_texel_cells_cut(struct kiln_texel_cells *cells, const struct kiln_texel_pieces *pieces);

/* Two cells with one line between them: the k-th such pair; false: there are no more. */
bool kiln_texel_cells_pair(const struct kiln_texel_cells *cells, uint32_t k, uint32_t pair[2]);
void kiln_texel_cells_join(struct kiln_texel_cells *cells, uint32_t first, uint32_t second);

/* A texel's parts, by area: what is joined, without what is buried. */
struct kiln_texel_parts {
    uint32_t count;
    double area[KILN_TEXEL_PARTS];      /* m2 */
    double centre[KILN_TEXEL_PARTS][2]; /* of its largest cell */
};

/* Makes the parts: lines, margin, codes, sides and `within` of `texel`. `margin`: in sides of the texel. Of more than
 * KILN_TEXEL_PARTS the smallest are left out, and so is what is thinner than the margin. `borders`: lines along the
 * texel's sides on which walls stand, with the texel at a x + b y <= c; those for which there is room are added. No
 * parts where there is no such line and light reaches all of the texel: it is whole. */
void kiln_texel_parts_make(const struct kiln_texel_cells *cells, const struct kiln_texel_pieces *pieces, double margin,
                           const float *borders, uint32_t border_count, struct kiln_divided_texel *texel,
                           struct kiln_texel_parts *parts);

/* Exchanges part 0 and part `part`. */
void kiln_texel_parts_show(struct kiln_divided_texel *texel, struct kiln_texel_parts *parts, uint32_t part);

/* m2 of a triangle that samples of a part are drawn from. */
double kiln_texel_part_area(const struct kiln_divided_texel *texel, uint32_t part,
                            const struct kiln_texel_pieces *pieces, uint32_t triangle);

#endif
