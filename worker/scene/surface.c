#include "worker/scene/surface.h"

#include <math.h>

#include "worker/base/memory.h"

const struct kiln_subtexel *kiln_surface_subtexel(const struct kiln_surface *s, struct kiln_global_point point)
{
    uint64_t low = 0, high = s->part_count;
    while (low < high) {
        const uint64_t middle = low + (high - low) / 2;
        if (s->parts[middle].point.at < point.at)
            low = middle + 1;
        else
            high = middle;
    }
    return low < s->part_count && s->parts[low].point.at == point.at ? &s->parts[low] : NULL;
}

/* `within`: m2 of the point's area. */
static void leave_out(struct kiln_surface *s, struct kiln_global_point point, float within)
{
    if (!(within > 0.0f) || point.at - s->first.at >= s->count)
        return;
    const uint64_t own = kiln_own_of_global(s, point).at;
    const double left = 1.0 - fmin(1.0, (double)within / (double)s->area[own]);
    if (s->visible[own] > 0)
        s->visible[own] = (uint16_t)fmax(1.0, round((double)s->visible[own] * left));
}

void kiln_surface_leave_walls_out(struct kiln_surface *s)
{
    for (uint64_t i = 0; i < s->divided_count; i++)
        leave_out(s, s->divided[i].part[0], s->divided[i].within);
}

struct kiln_global_point kiln_surface_find_leaf(const struct kiln_surface *s, uint32_t number, uint32_t x, uint32_t y,
                                                uint32_t layer)
{
    const struct kiln_brick_slot *slot =
        kiln_brick_slot(s, number, kiln_brick_place(x / KILN_BRICK_SIDE, y / KILN_BRICK_SIDE, layer / KILN_BRICK_SIDE));
    if (slot->tile == 0)
        return (struct kiln_global_point){KILN_NO_POINT};
    const uint32_t bit = kiln_morton4(x, y, layer),
                   brick = (uint32_t)(slot->tile - 1 - s->lightmaps[number].tile_first);
    return kiln_surface_find(s, number, KILN_TILE_SIDE * brick + kiln_morton8_x(bit), kiln_morton8_y(bit));
}

void kiln_surface_destroy(struct kiln_surface **surface)
{
    struct kiln_surface *s = *surface;
    if (s == NULL)
        return;
    if (!s->global_is_borrowed) {
        kiln_free(&s->tiles);
        kiln_free(&s->splits);
        kiln_free(&s->divided);
        kiln_free(&s->parts);
        kiln_free(&s->lightmaps);
        kiln_free(&s->bricks);
        kiln_free(&s->slots);
        kiln_free(&s->cell_first);
    }
    if (!s->own_is_borrowed) {
        kiln_free(&s->tile_runs);
        kiln_free(&s->piece_base);
        kiln_free(&s->area_cdf_base);
        kiln_free(&s->piece_count);
        kiln_free(&s->pieces);
        kiln_free(&s->area_cdf);
        kiln_free(&s->albedo);
        kiln_free(&s->area);
        kiln_free(&s->visible);
    }
    kiln_free(surface);
}
