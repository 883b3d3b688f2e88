/* Measurements on a lightmap while it is made. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_LIGHTMAP_REPORT_H
#define KILN_COORDINATOR_OUTPUT_MAP_LIGHTMAP_REPORT_H

#include <stdint.h>

/* Report of kiln_write_lightmaps on one lightmap, for run.json. Complete on rank 0; zeros on the others. */
struct kiln_lightmap_report {
    uint32_t map;
    uint64_t valid, filled, dilated; /* texels: gathered; filled from valid neighbours; margin */
    uint64_t contested, foreign;     /* texels that several charts read: of the margin; of a chart (borders.h) */
    double border, border_disturbed; /* length of chart borders, texels; the part that reads another chart */
    double seam_difference_before, seam_difference_after; /* root mean square over seam samples, relative to the mean */
    double texels_per_metre;                              /* density actually reached for the object */
    /* over valid texels: mean luminance of irradiance, by area; root mean square of its standard error / that mean */
    double mean, error;
    /* of a bake in parts (integrate/parts/parts.h): standard error of the mean over the mean, enlarged by
     * KILN_PARTS_STUDENT; else 0 */
    double mean_error;
    /* denoising: sums over gathered texels of area x variance of luminance, before and after, of direct and of indirect
     * light; time */
    double noise_before[2], noise_after[2], denoise_seconds;
};

#endif
