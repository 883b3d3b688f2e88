#include "coordinator/integrate/cells/light_mean.h"

#include "worker/base/color.h"

int kiln_light_mean(const struct kiln_integration *in, const float *values, const float *areas, double *mean,
                    struct kiln_error *error)
{
    const struct kiln_rank_data *own = in->solution->own;
    const double unit = kiln_exact_unit(kiln_radiosity_allgather_scale(in->solution->allgather));
    struct kiln_exact_sum sums[2] = {{0}, {0}}; /* values, points */
#pragma omp parallel
    {
        struct kiln_exact_sum some[2] = {{0}, {0}};
#pragma omp for schedule(static)
        for (uint64_t i = 0; i < own->surface.count; i++)
            if (kiln_point_valid(&own->surface, (struct kiln_own_point){i})) {
                const double value = kiln_luminance_of_floats(&values[3 * i]);
                kiln_exact_add(&some[0], areas != NULL ? (double)areas[i] * value : value, 1.0 / unit);
                some[1].value++;
            }
#pragma omp critical(kiln_light_mean)
        for (int k = 0; k < 2; k++)
            sums[k].value += some[k].value; /* exact: the order of threads does not matter */
    }
    const int status = kiln_exact_reduce(in->communicator, sums, 2, error);
    *mean = sums[1].value > 0 ? kiln_exact_value(&sums[0], unit) / (double)sums[1].value : 0.0;
    return status;
}
