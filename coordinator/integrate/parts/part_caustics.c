#include "coordinator/integrate/parts/part_caustics.h"

#include <math.h>

#include "coordinator/integrate/packing.h"
#include "coordinator/integrate/parts/part_errors.h"
#include "coordinator/integrate/parts/parts.h"
#include "worker/scene/radiosity.h"

enum {
    ROUNDING = 1 << 17, /* streams of rounding, after those of parts.c */
    SIDE = 8,           /* of a tile, texels */
    WINDOW = 5,         /* of the mean of an eye (published.h), texels */
    UNIT = 1024         /* of the sums of squares */
};
#define SQUARE_MOST 100.0 /* of a tile run: a few do not decide for all */
#define COST 4.0          /* of caustics at all points over that of all other samples, in the first round */
#define LEAST 0.01        /* of the variance: a tenth of the error */

/* ---- light of caustics ---- */

static uint64_t place_of(struct kiln_own_point own, uint32_t part) { return KILN_PARTS * own.at + part % KILN_PARTS; }

static void pack(uint64_t *packed, const float rgb[3], const struct kiln_tile_run *run, uint32_t bit,
                 const struct kiln_step *step, uint32_t which)
{
    const float sent[3] = {fmaxf(rgb[0], 0.0f), fmaxf(rgb[1], 0.0f), fmaxf(rgb[2], 0.0f)};
    *packed = kiln_radiosity_pack(sent, kiln_packing_hash(run, bit, ROUNDING + 2 * step->part + which));
}

void kiln_part_keep_caustics(const struct kiln_rank_data *data, struct kiln_own_point own,
                             const struct kiln_tile_run *run, uint32_t bit, float luminance, const float radiosity[3],
                             const struct kiln_step *step)
{
    if (data->parts_caustic == NULL)
        return;
    data->parts_caustic[place_of(own, step->part)] = luminance;
    pack(&data->parts_caustic_radiosity[place_of(own, step->part)], radiosity, run, bit, step, 0);
}

void kiln_part_mix_caustics(const struct kiln_rank_data *data, struct kiln_own_point own,
                            const struct kiln_tile_run *run, uint32_t bit, float luminance, const float radiosity[3],
                            const struct kiln_taking *taking)
{
    const struct kiln_step *step = taking->step;
    const uint64_t place = place_of(own, step->part);
    const float share = taking->weight.share, difference = share * (luminance - data->parts_caustic[place]);
    float before[3], now[3], sent[3];
    kiln_radiosity_unpack(data->parts_caustic_radiosity[place], before);
    kiln_radiosity_unpack(data->parts_radiosity[place], sent);
    for (int c = 0; c < 3; c++)
        now[c] = before[c] + share * (radiosity[c] - before[c]);
    pack(&data->parts_caustic_radiosity[place], now, run, bit, step, 0);
    kiln_radiosity_unpack(data->parts_caustic_radiosity[place], now);
    for (uint64_t c = 0; c < 3; c++) {
        sent[c] += now[c] - before[c];
        data->sum[3 * own.at + c] += now[c] - before[c];
        if (data->radiosity != NULL)
            data->radiosity[3 * own.at + c] += (now[c] - before[c]) / (float)KILN_PARTS;
    }
    pack(&data->parts_radiosity[place], sent, run, bit, step, 1);
    data->parts_caustic[place] += difference;
    data->parts[place] += difference;
}

float kiln_part_caustics_light(const struct kiln_rank_data *data, struct kiln_own_point own,
                               const struct kiln_step *step)
{
    return data->parts_caustic[place_of(own, step->part)];
}

void kiln_part_add_caustics(const struct kiln_rank_data *data, struct kiln_own_point own, const struct kiln_step *step,
                            float sum[3], float total[3])
{
    float rgb[3];
    for (uint32_t k = 0; k < KILN_PARTS; k++) {
        kiln_radiosity_unpack(data->parts_caustic_radiosity[place_of(own, k)], rgb);
        for (int c = 0; c < 3; c++) {
            total[c] += rgb[c] / (float)KILN_PARTS;
            sum[c] += k == step->part % KILN_PARTS ? rgb[c] : 0.0f;
        }
    }
}

/* ---- their share of the error ---- */

/* Sums of squares of what the parts' sums over a window differ by. */
static void add_window(const float *light, const double *there, int corner, double *square)
{
    double sums[KILN_PARTS] = {0.0}, mean = 0.0, count = 0.0;
    for (int y = 0; y < WINDOW; y++)
        for (int x = 0; x < WINDOW; x++) {
            const int place = corner + y * SIDE + x;
            count += there[place];
            for (int k = 0; k < KILN_PARTS; k++)
                sums[k] += (double)light[KILN_PARTS * place + k];
        }
    for (int k = 0; k < KILN_PARTS; k++)
        mean += sums[k] / KILN_PARTS;
    for (int k = 0; k < KILN_PARTS && count > 0.0; k++)
        *square += (sums[k] - mean) * (sums[k] - mean) / (count * count);
}

double kiln_part_caustics_share(const struct kiln_rank_data *data, const struct kiln_tile_run *run)
{
    static const int corners[] = {0, SIDE - WINDOW, (SIDE - WINDOW) * SIDE, (SIDE - WINDOW) * (SIDE + 1)};
    float all[KILN_PARTS * SIDE * SIDE] = {0.0f}, caustics[KILN_PARTS * SIDE * SIDE] = {0.0f};
    double there[SIDE * SIDE] = {0.0}, square = 0.0, of_caustics = 0.0;
    struct kiln_own_point own = kiln_own_of_global(&data->surface, run->first);
    if (data->parts_caustic == NULL)
        return 0.0;
    for (uint64_t rest = run->mask; rest != 0; rest &= rest - 1, own.at++) {
        const uint32_t bit = (uint32_t)__builtin_ctzll(rest);
        const int place = kiln_part_place(bit);
        there[place] = kiln_point_valid(&data->surface, own) ? 1.0 : 0.0;
        for (uint64_t k = 0; k < KILN_PARTS && there[place] > 0.0; k++) {
            all[KILN_PARTS * (uint64_t)place + k] = data->parts[KILN_PARTS * own.at + k];
            caustics[KILN_PARTS * (uint64_t)place + k] = data->parts_caustic[KILN_PARTS * own.at + k];
        }
    }
    for (size_t i = 0; i < sizeof corners / sizeof *corners; i++) {
        add_window(all, there, corners[i], &square);
        add_window(caustics, there, corners[i], &of_caustics);
    }
    return square > 0.0 ? fmin(of_caustics / square, 1.0) : 0.0;
}

void kiln_caustics_need_add(struct kiln_caustics_need *need, uint64_t points, double square, double share)
{
    const double bounded = fmin(square, SQUARE_MOST) * (double)points * UNIT;
    need->points += points;
    need->all += (uint64_t)bounded;
    need->caustics += (uint64_t)(share * bounded);
}

void kiln_caustics_need_reduce(struct kiln_caustics_need *need, MPI_Comm communicator)
{
    uint64_t sums[3] = {need->points, need->all, need->caustics};
    (void)MPI_Allreduce(MPI_IN_PLACE, sums, 3, MPI_UINT64_T, MPI_SUM, communicator);
    *need = (struct kiln_caustics_need){sums[0], sums[1], sums[2]};
}

double kiln_caustics_growth(const struct kiln_caustics_need *need, double caustics, double others, double share)
{
    const double all = (double)need->all, of_caustics = (double)need->caustics,
                 rest = fmax(all - of_caustics, LEAST * all);
    if (!(of_caustics > LEAST * all))
        return 0.0;
    return sqrt(of_caustics * caustics * share / (rest * others * COST)) * others / caustics;
}
