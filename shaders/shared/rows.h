/* Special words of a row (worker/pass/rows.h), which stand for a ray's hit without a surface point. */
#ifndef KILN_SHADERS_SHARED_ROWS_H
#define KILN_SHADERS_SHARED_ROWS_H

#define KILN_ROW_NO_POINT 0xffffffffu /* a surface without a surface point: black */
#define KILN_ROW_ESCAPED 0xfffffffeu
#define KILN_ROW_BLOCKED 0xfffffffdu /* the back of a single-sided surface */
#define KILN_ROW_POINTS 0xfffffff0u  /* maximum number of surface points that words can name */

#define KILN_ROW_LIGHTS 16u /* maximum number of lights that a device gathers at once */

/* Threads of a point for this number of lights; the size of a workgroup is a multiple. */
#define KILN_ROW_LANES(lights) ((lights) > 8u ? KILN_ROW_LIGHTS : (lights) > 4u ? 8u : (lights) > 2u ? 4u : (lights))

#endif
