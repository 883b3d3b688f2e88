#include "coordinator/integrate/part_errors.h"

#include <math.h>

enum {
    REACH = 2, /* texels: how far variances are averaged */
    SIDE = 8   /* of a tile, texels */
};

/* Square of the standard error of the mean over the parts at a point. */
static float variance_of(const float parts[KILN_PARTS])
{
    float mean = 0.0f, square = 0.0f;
    for (int k = 0; k < KILN_PARTS; k++)
        mean += parts[k] / (float)KILN_PARTS;
    for (int k = 0; k < KILN_PARTS; k++)
        square += (parts[k] - mean) * (parts[k] - mean);
    return square / (float)(KILN_PARTS * (KILN_PARTS - 1));
}

/* The variances of a tile run's points at their places in the tile; -1 where there is none. */
static void lay_out(const struct kiln_rank_data *data, const struct kiln_tile_run *run, float tile[SIDE * SIDE])
{
    struct kiln_own_point own = kiln_own_of_global(&data->surface, run->first);
    for (int i = 0; i < SIDE * SIDE; i++)
        tile[i] = -1.0f;
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, own.at++)
        if (kiln_point_valid(&data->surface, own))
            tile[__builtin_ctzll(rest)] = variance_of(data->parts + KILN_PARTS * own.at);
}

static float pooled(const float tile[SIDE * SIDE], int place)
{
    const int x = place % SIDE, y = place / SIDE;
    float sum = 0.0f, count = 0.0f;
    for (int v = y > REACH ? y - REACH : 0; v <= y + REACH && v < SIDE; v++)
        for (int u = x > REACH ? x - REACH : 0; u <= x + REACH && u < SIDE; u++)
            if (tile[v * SIDE + u] >= 0.0f) {
                sum += tile[v * SIDE + u];
                count += 1.0f;
            }
    return count > 0.0f ? sum / count : 0.0f;
}

void kiln_part_errors(const struct kiln_rank_data *data, const struct kiln_tile_run *run,
                      float errors[KILN_PART_ERRORS])
{
    float tile[SIDE * SIDE];
    lay_out(data, run, tile);
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1)
        *errors++ = sqrtf(pooled(tile, __builtin_ctzll(rest)));
}
