/* Cells of a texel: the pieces into which lines, along the walls that stand on the texel, cut it; and the texel's
 * parts, which are groups of joined cells (struct kiln_divided_texel of worker/scene/surface.h). This is geometry
 * alone: the caller traces rays and joins the cells. Pure. */
#ifndef KILN_COORDINATOR_BAKE_POINTS_TEXEL_CELLS_H
#define KILN_COORDINATOR_BAKE_POINTS_TEXEL_CELLS_H

#include "worker/scene/footprint.h"

enum { KILN_CELLS_MOST = 1 << KILN_CUT_LINES, KILN_CELL_PLACES = 5 };

/* Triangles of a texel, from which its cells are cut. Borrowed. */
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
    uint32_t joined;                   /* index of the first cell of its group of joined cells, or its own index */
    bool buried;                       /* it lies inside of a solid */
    double area;                       /* m2 */
    double centre[2];                  /* a place in it, in the texel's square */
    double place[KILN_CELL_PLACES][2]; /* further places in the cell, near the corners of its largest piece */
};

struct kiln_texel_cells {
    float lines[KILN_CUT_FLOATS];
    uint32_t line_count, count;
    struct kiln_texel_cell cell[KILN_CELLS_MOST]; /* in order of their codes */
};

/* Adds a line a x + b y = c in the texel's square, unless the line is already there or there are KILN_CUT_LINES lines.
 */
void kiln_texel_cells_add_line(struct kiln_texel_cells *cells, double a, double b, double c);

/* Cuts the texel along the lines. Leaves out lines that cut nothing off. */
void kiln_texel_cells_cut(struct kiln_texel_cells *cells, const struct kiln_texel_pieces *pieces);

/* Gets the k-th pair of cells that are separated by one line only; false: there are no more pairs. */
bool kiln_texel_cells_pair(const struct kiln_texel_cells *cells, uint32_t k, uint32_t pair[2]);
void kiln_texel_cells_join(struct kiln_texel_cells *cells, uint32_t first, uint32_t second);

/* Parts of a texel, by area: groups of joined cells, without buried cells. */
struct kiln_subtexels {
    uint32_t count;
    double area[KILN_SUBTEXELS];      /* m2 */
    double centre[KILN_SUBTEXELS][2]; /* of its largest cell */
};

/* Makes the parts of a texel, and fills in lines, margin, codes, sides and `within` of `texel`. `margin`: in sides of
 * the texel. Parts thinner than the margin are left out. So are the smallest parts, if there are more than
 * KILN_SUBTEXELS. `borders`: lines of walls that stand on the texel's sides; the texel lies where a x + b y <= c. These
 * lines are added to the texel's while there is room. A texel without borders that light reaches everywhere is whole,
 * and gets no parts; neither does one whose cells are all buried. */
void kiln_subtexels_make(const struct kiln_texel_cells *cells, const struct kiln_texel_pieces *pieces, double margin,
                         const float *borders, uint32_t border_count, struct kiln_divided_texel *texel,
                         struct kiln_subtexels *parts);

/* Exchanges part 0 and part `part`. */
void kiln_subtexels_show(struct kiln_divided_texel *texel, struct kiln_subtexels *parts, uint32_t part);

/* Area of the region of a triangle from which samples of a part are drawn, m2. */
double kiln_subtexel_area(const struct kiln_divided_texel *texel, uint32_t part, const struct kiln_texel_pieces *pieces,
                          uint32_t triangle);

#endif
