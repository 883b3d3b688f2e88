#include "worker/pass/patches.h"

#include <math.h>

void kiln_closing_keep(const struct kiln_patches_result *result, float closing[KILN_CLOSING_FLOATS])
{
    const struct kiln_point_mean mean = kiln_point_mean(&result->point);
    closing[KILN_CLOSING_SCALE] = result->row_scale;
    closing[KILN_CLOSING_ESCAPED] = mean.escaped;
    closing[KILN_CLOSING_BLOCKED] = mean.blocked;
    closing[KILN_CLOSING_PRESENT] = mean.present;
    for (int c = 0; c < 3; c++)
        closing[KILN_CLOSING_GLASS + c] = mean.glass[c];
}

struct kiln_point_result kiln_closing_rays(const float closing[KILN_CLOSING_FLOATS], uint32_t samples)
{
    const float n = (float)samples;
    struct kiln_point_result r = {.escaped = n * closing[KILN_CLOSING_ESCAPED],
                                  .blocked = n * closing[KILN_CLOSING_BLOCKED],
                                  .present = closing[KILN_CLOSING_PRESENT],
                                  .count = samples};
    for (int c = 0; c < 3; c++)
        r.glass[c] = n * closing[KILN_CLOSING_GLASS + c];
    return r;
}

double kiln_patches_row_scale(const struct kiln_point_result *gathered, double row)
{
    const struct kiln_point_mean mean = kiln_point_mean(gathered);
    const double samples = (double)mean.count, lost = (double)mean.escaped + (double)mean.blocked,
                 glass = ((double)mean.glass[0] + (double)mean.glass[1] + (double)mean.glass[2]) / 3.0,
                 met = fmax(0.0, 1.0 - lost - glass), off = met - row,
                 few = lost * pow(fmin(fmax(met, row), 1.0), 0.25), /* losses where few or no rays have hit anything */
        chance = 3.0 * fmax(sqrt(fmax(0.0, lost * (1.0 - lost))), few) * pow(samples, -0.75);
    if (!(row > 0.0))
        return 1.0;
    return 1.0 + off * (off != 0.0 ? fmax(0.0, 1.0 - chance * chance / (off * off)) : 0.0) / row;
}
