#include "coordinator/output/map/denoise/ghosts.h"

#include <math.h>
#include <stdlib.h>

#include "worker/base/memory.h"

enum { TILE = 8 };

static int compare_tiles(const void *a, const void *b)
{
    const struct kiln_ghost_tile *p = a, *q = b;
    if (p->from != q->from)
        return p->from < q->from ? -1 : 1;
    if (p->tile != q->tile)
        return p->tile < q->tile ? -1 : 1;
    return (p->to > q->to) - (p->to < q->to);
}

/* Distance between the middle of a tile and a segment on the layout, in texels. */
static float distance_to(const float segment[2][2], uint32_t column, uint32_t row)
{
    const float x = (float)(TILE * column) + 0.5f * TILE - segment[0][0],
                y = (float)(TILE * row) + 0.5f * TILE - segment[0][1], dx = segment[1][0] - segment[0][0],
                dy = segment[1][1] - segment[0][1], square = dx * dx + dy * dy;
    const float t = square > 0.0f ? fminf(fmaxf((x * dx + y * dy) / square, 0.0f), 1.0f) : 0.0f;
    return hypotf(x - t * dx, y - t * dy);
}

/* Finds the tiles that the interval `low` to `high`, in texels and widened, overlaps; there are `count` tiles. */
static void find_tiles(float low, float high, uint32_t count, uint32_t *begin, uint32_t *end)
{
    const float first = floorf((fminf(low, high) - KILN_GHOST_TEXELS) / TILE),
                last = floorf((fmaxf(low, high) + KILN_GHOST_TEXELS) / TILE);
    *begin = first > 0.0f ? (uint32_t)first : 0;
    *end = last >= (float)(count - 1) ? count : last < 0.0f ? 0 : (uint32_t)last + 1;
}

/* Appends the tiles of one side of a joint that the other side's map sees. */
static int add_side(struct kiln_ghosts *g, size_t *capacity, const struct kiln_joint *joint, int side,
                    const struct kiln_surface *surface, struct kiln_error *error)
{
    const struct kiln_lightmap *map = &surface->lightmaps[joint->map[side]];
    const float(*segment)[2] = joint->edge.texel[side];
    /* half of a tile's diagonal from its middle */
    const float most = KILN_GHOST_TEXELS + 0.5f * TILE * sqrtf(2.0f);
    uint32_t x0, x1, y0, y1;
    int status = KILN_OK;
    find_tiles(segment[0][0], segment[1][0], map->tiles_x, &x0, &x1);
    find_tiles(segment[0][1], segment[1][1], map->tiles_y, &y0, &y1);
    for (uint32_t y = y0; y < y1; y++)
        for (uint32_t x = x0; x < x1 && status == KILN_OK; x++) {
            if (distance_to(segment, x, y) > most)
                continue;
            status = kiln_grow(&g->tiles, capacity, g->count + 1, sizeof *g->tiles, "tiles near joints", error);
            if (status == KILN_OK)
                g->tiles[g->count++] =
                    (struct kiln_ghost_tile){joint->map[side], y * map->tiles_x + x, joint->map[1 - side]};
        }
    return status;
}

static void drop_doubles(struct kiln_ghosts *g)
{
    size_t kept = 0;
    if (g->count > 1)
        qsort(g->tiles, g->count, sizeof *g->tiles, compare_tiles);
    for (size_t i = 0; i < g->count; i++)
        if (kept == 0 || compare_tiles(&g->tiles[kept - 1], &g->tiles[i]) != 0)
            g->tiles[kept++] = g->tiles[i];
    g->count = kept;
}

int kiln_ghosts_create(struct kiln_ghosts **ghosts, const struct kiln_joints *joints,
                       const struct kiln_surface *surface, struct kiln_error *error)
{
    size_t capacity = 0, many = 1 << 16;
    int status = kiln_allocate(ghosts, 1, sizeof **ghosts, "tiles near joints", error);
    for (size_t i = 0; status == KILN_OK && i < joints->count; i++) {
        for (int side = 0; side < 2 && status == KILN_OK; side++)
            status = add_side(*ghosts, &capacity, &joints->joints[i], side, surface, error);
        if (status == KILN_OK && (*ghosts)->count > many) { /* short joints have the same tiles many times */
            drop_doubles(*ghosts);
            many = 2 * (*ghosts)->count > many ? 2 * (*ghosts)->count : many;
        }
    }
    if (status == KILN_OK)
        drop_doubles(*ghosts);
    else
        kiln_ghosts_destroy(ghosts);
    return status;
}

void kiln_ghosts_destroy(struct kiln_ghosts **ghosts)
{
    if (*ghosts == NULL)
        return;
    kiln_free(&(*ghosts)->tiles);
    kiln_free(ghosts);
}

size_t kiln_ghosts_of(const struct kiln_ghosts *ghosts, uint32_t from, uint32_t tile, size_t *first)
{
    const struct kiln_ghost_tile key = {.from = from, .tile = tile};
    if (ghosts == NULL)
        return 0;
    size_t low = 0, high = ghosts->count;
    while (low < high) {
        const size_t middle = low + (high - low) / 2;
        if (compare_tiles(&ghosts->tiles[middle], &key) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    *first = low;
    while (high < ghosts->count && ghosts->tiles[high].from == from && ghosts->tiles[high].tile == tile)
        high++;
    return high - low;
}
