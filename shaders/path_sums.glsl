/* Sums of the light that paths bring to their pixels, path after path. Needs shaders/kernel.glsl before. */
#include "shaders/sum.glsl"
#include "shaders/shared/color.h"

KILN_ARRAY(PathSums, kiln_gpu_path_sums, 4);

void path_add(inout kiln_gpu_path_sums sums, vec3 radiance)
{
    const float luminance = float_luminance(radiance);
    const float added[4] = float[4](radiance.r, radiance.g, radiance.b, luminance * luminance);
    for (uint c = 0u; c < 4u; c++) {
        kiln_sum sum = kiln_sum(sums.high[c], sums.low[c]);
        kiln_add(sum, added[c]);
        sums.high[c] = sum.high;
        sums.low[c] = sum.low;
    }
}

/* Ends the samples of a pixel in this dispatch. `good`: the device has ended no loop early. */
void path_end(inout kiln_gpu_path_sums sums, bool good, uint rays)
{
    good = good && sums.count != KILN_GPU_PATH_STOPPED;
    sums.count = good ? sums.count + push.samples : KILN_GPU_PATH_STOPPED;
    sums.rays += rays;
}
