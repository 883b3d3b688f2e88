#include "coordinator/integrate/land/land_state.h"

#include <math.h>

enum { PATHS_AN_AIM = 4 };
/* RAYS_SHARE: divisor of a gather's samples; FEW_FROM: sample count up to which it is not divided */
enum { RAYS_SHARE = 4, FEW_FROM = 16 };
/* objects are cut into up to AIMS_MOST aims, with PATHS_OF_CUTS paths each */
enum { AIMS_MOST = 1024, PATHS_OF_CUTS = 64 };

bool kiln_landing_spreads(const struct kiln_integrate_settings *settings)
{
    return settings->caustics == KILN_CAUSTICS_VCM && settings->merge_radius != KILN_MERGE_RADIUS_TEXEL;
}

uint64_t kiln_landing_photons(const struct kiln_integrate_settings *settings, size_t aims)
{
    const uint64_t photons = settings->photons, least = PATHS_AN_AIM * (uint64_t)aims;
    return settings->photons_given || photons > least ? photons : least;
}

uint32_t kiln_landing_rays(const struct kiln_integrate_settings *s, uint32_t samples, bool images)
{
    const bool few = s->caustics == KILN_CAUSTICS_VCM && !kiln_has_rounds(s) && !images;
    return few && samples >= FEW_FROM && samples % (2 * RAYS_SHARE) == 0 ? samples / RAYS_SHARE : samples;
}

size_t kiln_landing_aims(const struct kiln_integrate_settings *settings)
{
    const uint64_t most = settings->photons / PATHS_OF_CUTS;
    return most < AIMS_MOST ? (size_t)most : AIMS_MOST;
}

uint64_t kiln_landing_bytes(const struct kiln_integrate_settings *settings, size_t aims, double points, uint32_t ranks,
                            double landed)
{
    const double photons = (double)kiln_landing_photons(settings, aims),
                 block = fmin(photons, (double)KILN_LAND_BATCH) / ranks,
                 record = (double)sizeof(struct kiln_landing_record), number = (double)sizeof(uint32_t),
                 sent = (2.0 * record + 2.0 * number) * landed,
                 shared = record + number + 2.0 * number * landed, /* it has room for all paths */
        records = block * (ranks > 1 ? fmax(sent, shared) : (record + 2.0 * number) * landed),
                 aim = (double)sizeof(struct kiln_aim) + 6.0 * sizeof(double);
    double point = (double)kiln_landing_saved_bytes(settings->caustics);
    if (settings->caustics == KILN_CAUSTICS_MERGE)
        point += (double)KILN_MERGE_POINT_BYTES;
    if (kiln_landing_spreads(settings)) /* and a radius */
        point += (double)(sizeof(struct kiln_merged) + sizeof(struct kiln_landing_sum) + KILN_MERGE_POINT_BYTES +
                          sizeof(float));
    if (settings->caustics >= KILN_CAUSTICS_MERGE) /* and what is there to be lit */
        point += (double)sizeof(float);
    return (uint64_t)(records + aim * (double)aims + point * points);
}

uint64_t kiln_landing_saved_bytes(enum kiln_caustics caustics)
{
    return caustics < KILN_CAUSTICS_LAND
               ? 0
               : sizeof(struct kiln_landing_sum) + (caustics == KILN_CAUSTICS_MERGE ? sizeof(struct kiln_merged) : 0);
}
