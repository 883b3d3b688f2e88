#include "coordinator/bake/points/texel_cells.h"

#include <math.h>
#include <string.h>

static const double SAME_LINE = 2e-4;   /* of a texel's side, or radians */
static const double LEAST_SHARE = 1e-7; /* least fraction of a texel's area that makes a cell */
/* distance of a cell's outer places from its middle, relative to its corners */
static const double NEAR_CORNERS = 0.99;

/* ---- lines ---- */

static bool is_same(const float *line, double a, double b, double c)
{
    return fabs((double)line[0] - a) < SAME_LINE && fabs((double)line[1] - b) < SAME_LINE &&
           fabs((double)line[2] - c) < SAME_LINE;
}

void kiln_texel_cells_add_line(struct kiln_texel_cells *cells, double a, double b, double c)
{
    const double length = hypot(a, b), sign = fabs(a) >= fabs(b) ? copysign(1.0, a) : copysign(1.0, b);
    if (!(length > 0.0) || cells->line_count == KILN_CUT_LINES)
        return;
    a *= sign / length, b *= sign / length, c *= sign / length;
    for (uint32_t i = 0; i < cells->line_count; i++)
        if (is_same(&cells->lines[3 * i], a, b, c) || is_same(&cells->lines[3 * i], -a, -b, -c))
            return;
    float *line = &cells->lines[3 * cells->line_count++];
    line[0] = (float)a, line[1] = (float)b, line[2] = (float)c;
}

/* ---- cells ---- */

static uint32_t clip_to_cell(const struct kiln_texel_cells *cells, uint32_t code,
                             struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], uint32_t corners)
{
    for (uint32_t i = 0; i < cells->line_count; i++) {
        const float *l = &cells->lines[3 * i], sign = (code >> i & 1) != 0 ? -1.0f : 1.0f;
        const float side[3] = {sign * l[0], sign * l[1], sign * l[2]};
        corners = kiln_clip_line(polygon, corners, side);
    }
    return corners;
}

static uint32_t clip_to_texel(const struct kiln_texel_pieces *p, uint32_t piece,
                              struct kiln_clip_corner polygon[KILN_CLIP_CORNERS])
{
    struct kiln_texel_triangle local;
    kiln_texel_triangle(p->scene, p->geometry, p->triangles[piece], p->place, &local);
    return kiln_texel_clip(&local, 0.0, 0.0, 1.0, 1.0, polygon);
}

static double area_of(const struct kiln_texel_pieces *p, uint32_t triangle, const struct kiln_clip_corner *polygon,
                      uint32_t corners, struct kiln_clip_corner *middle)
{
    return corners < 3
               ? 0.0
               : kiln_clip_fraction(polygon, corners, middle) * kiln_geometry_triangle_area(p->geometry, triangle);
}

static void set_places(struct kiln_texel_cell *cell, const struct kiln_clip_corner *polygon, uint32_t corners,
                       const struct kiln_clip_corner *middle)
{
    cell->centre[0] = middle->x;
    cell->centre[1] = middle->y;
    for (uint32_t k = 0; k < KILN_CELL_PLACES; k++) {
        const struct kiln_clip_corner *corner = &polygon[k * corners / KILN_CELL_PLACES];
        cell->place[k][0] = middle->x + NEAR_CORNERS * (corner->x - middle->x);
        cell->place[k][1] = middle->y + NEAR_CORNERS * (corner->y - middle->y);
    }
}

/* The cell of a code, by its pieces; its area is 0 if it has none. */
static struct kiln_texel_cell make_cell(const struct kiln_texel_cells *cells, const struct kiln_texel_pieces *p,
                                        uint32_t code)
{
    struct kiln_texel_cell cell = {.code = code};
    double largest = 0.0;
    for (uint32_t i = 0; i < p->count; i++) {
        struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], middle = {0};
        const uint32_t corners = clip_to_cell(cells, code, polygon, clip_to_texel(p, i, polygon));
        const double area = area_of(p, p->triangles[i], polygon, corners, &middle);
        cell.area += area;
        if (area > largest) {
            largest = area;
            set_places(&cell, polygon, corners, &middle);
        }
    }
    return cell;
}

/* Whether a line divides the texel, that is, has cells on both sides. Bit `line` of a cell's code is its side. */
static bool cuts(const struct kiln_texel_cells *cells, uint32_t line)
{
    uint32_t sides = 0;
    for (uint32_t i = 0; i < cells->count; i++)
        sides |= 1u << (cells->cell[i].code >> line & 1);
    return sides == 3;
}

static void find_cells(struct kiln_texel_cells *cells, const struct kiln_texel_pieces *pieces)
{
    double total = 0.0;
    uint32_t kept = 0;
    cells->count = 1u << cells->line_count;
    for (uint32_t code = 0; code < cells->count; code++) {
        cells->cell[code] = make_cell(cells, pieces, code);
        total += cells->cell[code].area;
    }
    for (uint32_t i = 0; i < cells->count; i++)
        if (cells->cell[i].area > LEAST_SHARE * total) {
            cells->cell[kept] = cells->cell[i];
            cells->cell[kept].joined = kept;
            kept++;
        }
    cells->count = kept;
}

void kiln_texel_cells_cut(struct kiln_texel_cells *cells, const struct kiln_texel_pieces *pieces)
{
    find_cells(cells, pieces);
    uint32_t kept = 0;
    for (uint32_t i = 0; i < cells->line_count; i++)
        if (cuts(cells, i))
            memmove(&cells->lines[3 * kept++], &cells->lines[3 * i], 3 * sizeof *cells->lines);
    if (kept == cells->line_count)
        return;
    cells->line_count = kept;
    find_cells(cells, pieces);
}

bool kiln_texel_cells_pair(const struct kiln_texel_cells *cells, uint32_t k, uint32_t pair[2])
{
    for (uint32_t i = 0; i < cells->count; i++)
        for (uint32_t j = i + 1; j < cells->count; j++)
            if (__builtin_popcount(cells->cell[i].code ^ cells->cell[j].code) == 1 && k-- == 0) {
                pair[0] = i, pair[1] = j;
                return true;
            }
    return false;
}

void kiln_texel_cells_join(struct kiln_texel_cells *cells, uint32_t first, uint32_t second)
{
    const uint32_t a = cells->cell[first].joined, b = cells->cell[second].joined, low = a < b ? a : b,
                   high = a < b ? b : a;
    for (uint32_t i = 0; i < cells->count; i++)
        if (cells->cell[i].joined == high)
            cells->cell[i].joined = low;
}

/* ---- parts ---- */

/* A group: cells that are joined into one subtexel. */
struct group {
    uint32_t root, largest; /* indices of cells */
    double area;
};

static bool is_lit(const struct kiln_texel_cells *cells, uint32_t root)
{
    for (uint32_t i = 0; i < cells->count; i++)
        if (cells->cell[i].joined == root && !cells->cell[i].buried)
            return true;
    return false;
}

/* Groups of cells that light reaches, by falling area. */
static uint32_t find_groups(const struct kiln_texel_cells *cells, struct group groups[KILN_CELLS_MOST])
{
    uint32_t count = 0;
    for (uint32_t root = 0; root < cells->count; root++) {
        struct group g = {.root = root, .largest = root};
        if (cells->cell[root].joined != root || !is_lit(cells, root))
            continue;
        for (uint32_t i = root; i < cells->count; i++)
            if (cells->cell[i].joined == root) {
                g.area += cells->cell[i].area;
                g.largest = cells->cell[i].area > cells->cell[g.largest].area ? i : g.largest;
            }
        uint32_t at = count++;
        for (; at > 0 && groups[at - 1].area < g.area; at--)
            groups[at] = groups[at - 1];
        groups[at] = g;
    }
    return count;
}

/* Whether all cells whose codes agree with `code` in the bits of `mask` are of one group. */
static bool is_of_group(const struct kiln_texel_cells *cells, uint32_t root, uint32_t mask, uint32_t code)
{
    for (uint32_t i = 0; i < cells->count; i++)
        if (((cells->cell[i].code ^ code) & mask) == 0 && cells->cell[i].joined != root)
            return false;
    return true;
}

/* Finds lines that bound a convex set of a group's cells, the largest cell among them. A line that the set can do
 * without is left out. */
static uint32_t bounds_of(const struct kiln_texel_cells *cells, const struct group *group)
{
    const uint32_t code = cells->cell[group->largest].code;
    uint32_t mask = (1u << cells->line_count) - 1;
    for (uint32_t i = 0; i < cells->line_count; i++)
        if (is_of_group(cells, group->root, mask & ~(1u << i), code))
            mask &= ~(1u << i);
    return mask | code << 4;
}

static void set_code(struct kiln_divided_texel *texel, uint32_t code, uint32_t part)
{
    uint32_t *word = &texel->codes[code / 8];
    *word = (*word & ~(15u << code % 8 * 4)) | part << code % 8 * 4;
}

double kiln_subtexel_area(const struct kiln_divided_texel *texel, uint32_t part, const struct kiln_texel_pieces *pieces,
                          uint32_t triangle)
{
    struct kiln_clip_corner polygon[KILN_CLIP_CORNERS], middle;
    struct kiln_texel_triangle local;
    kiln_texel_triangle(pieces->scene, pieces->geometry, triangle, pieces->place, &local);
    const uint32_t corners =
        kiln_subtexel_clip(texel, part, polygon, kiln_texel_clip(&local, 0.0, 0.0, 1.0, 1.0, polygon));
    return area_of(pieces, triangle, polygon, corners, &middle);
}

static bool has_room(const struct kiln_divided_texel *texel, uint32_t part, const struct kiln_texel_pieces *pieces)
{
    for (uint32_t i = 0; i < pieces->count; i++) {
        const double area = kiln_subtexel_area(texel, part, pieces, pieces->triangles[i]);
        if (area > 0.0 &&
            !kiln_texel_is_sliver(pieces->scene, pieces->geometry, pieces->triangles[i], pieces->place, area))
            return true;
    }
    return false;
}

static void add_part(const struct kiln_texel_cells *cells, const struct group *group,
                     const struct kiln_texel_pieces *pieces, struct kiln_divided_texel *texel,
                     struct kiln_subtexels *parts)
{
    const uint32_t part = parts->count;
    const uint32_t before = texel->sides;
    texel->sides = (before & ~(0xffu << 8 * part)) | bounds_of(cells, group) << 8 * part;
    if (!has_room(texel, part, pieces)) {
        texel->sides = before;
        return;
    }
    for (uint32_t i = 0; i < cells->count; i++)
        if (cells->cell[i].joined == group->root && !cells->cell[i].buried)
            set_code(texel, cells->cell[i].code, part);
    parts->area[part] = group->area;
    memcpy(parts->centre[part], cells->cell[group->largest].centre, sizeof parts->centre[part]);
    parts->count++;
}

/* Gives codes of cells that are too small to exist the part of a neighbouring cell. */
static void fill_codes(const struct kiln_texel_cells *cells, struct kiln_divided_texel *texel)
{
    uint32_t there = 0;
    for (uint32_t i = 0; i < cells->count; i++)
        there |= 1u << cells->cell[i].code;
    for (uint32_t code = 0; code < 1u << cells->line_count; code++)
        for (uint32_t i = 0; i < cells->line_count && (there >> code & 1) == 0; i++) {
            const uint32_t beside = code ^ 1u << i;
            if ((there >> beside & 1) != 0)
                set_code(texel, code, kiln_cut_subtexel(texel->codes[0], texel->codes[1], beside));
        }
}

static bool any_buried(const struct kiln_texel_cells *cells)
{
    bool any = false;
    for (uint32_t i = 0; i < cells->count; i++)
        any = any || cells->cell[i].buried;
    return any;
}

/* Adds lines of walls on the texel's border. All parts lie on the inner side of them. */
static void add_borders(const float *borders, uint32_t count, struct kiln_divided_texel *texel)
{
    for (uint32_t i = 0; i < count && texel->line_count < KILN_CUT_LINES; i++) {
        memcpy(&texel->lines[3 * texel->line_count], &borders[3 * i], 3 * sizeof *borders);
        for (uint32_t k = 0; k < KILN_SUBTEXELS; k++)
            texel->sides |= 1u << texel->line_count << 8 * k;
        texel->line_count++;
    }
}

void kiln_subtexels_make(const struct kiln_texel_cells *cells, const struct kiln_texel_pieces *pieces, double margin,
                         const float *borders, uint32_t border_count, struct kiln_divided_texel *texel,
                         struct kiln_subtexels *parts)
{
    struct group groups[KILN_CELLS_MOST];
    const uint32_t count = find_groups(cells, groups);
    double total = 0.0;
    *parts = (struct kiln_subtexels){0};
    if (count == 0 || (count == 1 && border_count == 0 && !any_buried(cells)))
        return;
    for (int k = 0; k < KILN_SUBTEXELS; k++)
        texel->part[k].at = KILN_NO_POINT;
    memcpy(texel->lines, cells->lines, sizeof texel->lines);
    texel->line_count = cells->line_count;
    texel->margin = (float)margin;
    texel->codes[0] = texel->codes[1] = 0xffffffffu;
    texel->sides = 0;
    for (uint32_t g = 0; g < count && parts->count < KILN_SUBTEXELS; g++)
        add_part(cells, &groups[g], pieces, texel, parts);
    fill_codes(cells, texel);
    add_borders(borders, border_count, texel);
    for (uint32_t i = 0; i < cells->count; i++)
        total += cells->cell[i].area;
    for (uint32_t k = 0; k < parts->count; k++)
        total -= parts->area[k];
    texel->within = (float)fmax(total, 0.0);
}

void kiln_subtexels_show(struct kiln_divided_texel *texel, struct kiln_subtexels *parts, uint32_t part)
{
    const uint32_t first = texel->sides & 0xffu, other = texel->sides >> 8 * part & 0xffu;
    const struct kiln_subtexels before = *parts;
    if (part == 0)
        return;
    texel->sides = (texel->sides & ~(0xffu | 0xffu << 8 * part)) | other | first << 8 * part;
    for (uint32_t code = 0; code < 1u << texel->line_count; code++) {
        const uint32_t of = kiln_cut_subtexel(texel->codes[0], texel->codes[1], code);
        if (of == 0 || of == part)
            set_code(texel, code, of == 0 ? part : 0);
    }
    parts->area[0] = before.area[part], parts->area[part] = before.area[0];
    memcpy(parts->centre[0], before.centre[part], sizeof parts->centre[0]);
    memcpy(parts->centre[part], before.centre[0], sizeof parts->centre[0]);
}
