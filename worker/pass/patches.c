#include "worker/pass/patches.h"

#include <math.h>

double kiln_patches_row_scale(const struct kiln_point_result *gathered, double row)
{
    const struct kiln_point_mean mean = kiln_point_mean(gathered);
    const double samples = (double)mean.count, lost = (double)mean.escaped + (double)mean.blocked,
                 glass = ((double)mean.glass[0] + (double)mean.glass[1] + (double)mean.glass[2]) / 3.0,
                 chance = 3.0 * sqrt(fmax(0.0, lost * (1.0 - lost))) * pow(samples, -0.75),
                 off = fmax(0.0, 1.0 - lost - glass) - row;
    if (!(row > 0.0))
        return 1.0;
    return 1.0 + off * (off != 0.0 ? fmax(0.0, 1.0 - chance * chance / (off * off)) : 0.0) / row;
}
