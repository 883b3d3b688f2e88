/* What the passes that light surface points (direct.h, gather.h) give: one struct for each point of a tile run. */
#ifndef KILN_WORKER_PASS_POINT_H
#define KILN_WORKER_PASS_POINT_H

/* The mean over the point's samples; their number is the batch's. All zeros for a point that is not valid
 * (kiln_point_valid): no sample is taken there.
 *
 * Means and not sums, because the division is not one operation that a caller could do with the same bits. Embree sums
 * in double and multiplies by 1 / samples before it rounds to float; Vulkan divides a sum of two floats. In the direct
 * pass there is no one number to divide by: each light that is chosen has its own share of the samples. */
struct kiln_point_result {
    float irradiance[3]; /* about the shading normal, W/m2: the lightmap's quantity */
    float incident[3];   /* about the geometric normal, W/m2: what is absorbed or reflected */
    /* standard error of the luminance of `irradiance`, W/m2 (an upper estimate: from the spread of the means of the
     * four quarters of the samples) */
    float error;
    float escaped; /* share of gather rays that met nothing (0 in the direct pass) */
    float blocked; /* share of gather rays that met the back of a single-sided surface (0 in the direct pass) */
    /* by colour: share of what gather rays find that tinted surfaces on the way take; 0 without any */
    float glass[3];
    /* mean opacity of the point (kiln_surface_opacity): share of its area that is there to be lit; 1 for opaque ones */
    float present;
};

#endif
