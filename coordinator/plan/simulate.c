#include "coordinator/plan/simulate.h"

#include <math.h>

#include "coordinator/run/control.h"

static const double SAVE_START = 2e-3; /* s: folders, manifest and synchronisation of a checkpoint of any size */
static const double NODE_MEMORY_BANDWIDTH = 10e9; /* bytes per second between ranks of one node */
/* Width of the margin around a part of a lightmap (output/map/denoise/denoise_parts.h), in texels that cost as much as
 * own ones: the margin has some 42 texels, of which 16 on average go through each sweep. */
static const double SEEN = 16.0;

/* Seconds of an exchange after which all ranks have `bytes`, a part from each. An all-gather by recursive doubling over
 * n nodes takes ceil(log2 n) latencies, and (n - 1) / n of the bytes at the bandwidth of a node (Thakur, Rabenseifner,
 * Gropp: Optimization of Collective Communication Operations in MPICH, 2005, section 4.1). Within one node the
 * bandwidth is that of its memory. */
static double exchange_seconds(double bytes, uint32_t ranks, uint32_t nodes, double bandwidth, double latency)
{
    if (nodes > 1)
        return bytes * (nodes - 1.0) / nodes / bandwidth + ceil(log2(nodes)) * latency;
    return ranks > 1 ? bytes / NODE_MEMORY_BANDWIDTH : 0.0;
}

/* Seconds to find the surface points and tell all ranks; each rank of a node receives them. */
static double find_seconds(const struct kiln_simulation *s, const struct kiln_scaled *scaled, uint32_t together)
{
    const double own = s->find_a_point * scaled->points / scaled->ranks,
                 map = scaled->ranks > 1 ? s->map_a_point * scaled->points : 0.0;
    return own + map +
           exchange_seconds(s->map_bytes * scaled->points * together, scaled->ranks, scaled->nodes, s->light.bandwidth,
                            s->light.latency);
}

/* Number of texels in the margin that a rank denoises around its part of the largest lightmap: the part is a square
 * with a margin on all sides. */
static double seen_texels(const struct kiln_simulation *s, const struct kiln_scaled *scaled, double density)
{
    const double side = sqrt(s->largest_map * density / scaled->ranks);
    return scaled->ranks > 1 ? 4.0 * SEEN * (side + SEEN) : 0.0;
}

/* Seconds to write the files. Work is divided between ranks, except the margins of the largest lightmap. Work of a
 * single rank is added, as if nothing could overlap it. */
static double write_seconds(const struct kiln_simulation *s, const struct kiln_scaled *scaled, double density)
{
    return s->shared_a_point * scaled->points / scaled->ranks + s->seen_a_texel * seen_texels(s, scaled, density) +
           scaled->alone;
}

/* Adds the checkpoints written during `light` seconds: one per --checkpoint-every, and more between steps where they
 * are cheap (coordinator/run/control.h). */
static void save(const struct kiln_simulation *s, double light, struct kiln_scaled *scaled)
{
    const double bytes = s->saved_bytes * scaled->points,
                 cost = SAVE_START + bytes / scaled->nodes / s->saved_bandwidth;
    if (!(s->save_every > 0.0) || !(bytes > 0.0))
        return;
    const double between =
        fmin((double)s->light.steps->count, floor(light / kiln_control_due_after(s->save_every, cost)));
    scaled->saves = fmax(floor(light / s->save_every), between);
    scaled->save = scaled->saves * (cost + s->copied_byte * bytes / scaled->ranks);
}

int kiln_simulate(const struct kiln_simulation *s, uint32_t ranks, double density, struct kiln_scaled *scaled,
                  struct kiln_error *error)
{
    const struct kiln_light_simulation *l = &s->light;
    const uint32_t together = l->ranks_per_node > 0 ? l->ranks_per_node : 1;
    *scaled =
        (struct kiln_scaled){.ranks = ranks, .nodes = (ranks + together - 1) / together, .trace = s->shared / ranks};
    const int status = kiln_simulate_light(l, ranks, density, &scaled->light, error);
    if (status != KILN_OK)
        return status;
    for (size_t i = 0; i < l->cell_count; i++)
        scaled->points += density * (double)l->cell_points[i];
    for (uint32_t i = 0; i < l->steps->roles.count; i++)
        scaled->trace += scaled->light.seconds[i];
    scaled->exchange = s->exchanges * exchange_seconds(s->radiosity_bytes * scaled->points, ranks, scaled->nodes,
                                                       l->bandwidth, l->latency);
    scaled->find = find_seconds(s, scaled, together < ranks ? together : ranks);
    scaled->once = s->once;
    scaled->alone = s->alone_a_point * scaled->points;
    scaled->write = write_seconds(s, scaled, density);
    save(s, scaled->trace + scaled->light.move + scaled->exchange, scaled);
    scaled->seconds = scaled->trace + scaled->light.move + scaled->exchange + scaled->save + scaled->find +
                      scaled->once + scaled->write;
    return KILN_OK;
}

/* Sets the efficiency, relative to the first entry without its checkpoints, which would make others look too good.
 * `work`: amount of work relative to the first entry. */
static void rate(const struct kiln_scaled *first, struct kiln_scaled *scaled, double work)
{
    const double ideal = work / scaled->ranks;
    scaled->efficiency = scaled->seconds > 0.0 ? ideal * (first->seconds - first->save) / scaled->seconds : 1.0;
    const double traced = scaled->trace + scaled->light.move + scaled->exchange;
    scaled->trace_efficiency =
        traced > 0.0 ? ideal * (first->trace + first->light.move + first->exchange) / traced : 1.0;
}

int kiln_simulate_curves(const struct kiln_simulation *s, uint32_t most, struct kiln_scaled *strong,
                         struct kiln_scaled *weak, size_t *count, struct kiln_error *error)
{
    int status = KILN_OK;
    *count = 0;
    for (uint32_t ranks = 1; status == KILN_OK && *count<KILN_CURVE_MAX; ranks = ranks> most / 2 ? most : 2 * ranks) {
        const size_t i = *count;
        status = kiln_simulate(s, ranks, s->density, &strong[i], error);
        if (status == KILN_OK)
            status = kiln_simulate(s, ranks, s->density * ranks, &weak[i], error);
        rate(&strong[0], &strong[i], 1.0);
        rate(&weak[0], &weak[i], ranks);
        ++*count;
        if (ranks >= most)
            break;
    }
    return status;
}
