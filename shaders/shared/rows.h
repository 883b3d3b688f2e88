/* The words of a row (worker/pass/rows.h) that name no surface point: what a ray met there. */
#ifndef KILN_SHADERS_SHARED_ROWS_H
#define KILN_SHADERS_SHARED_ROWS_H

#define KILN_ROW_NO_POINT 0xffffffffu /* a surface, beside every point: black */
#define KILN_ROW_ESCAPED 0xfffffffeu
#define KILN_ROW_BLOCKED 0xfffffffdu /* the back of a single-sided surface */
#define KILN_ROW_POINTS 0xfffffff0u  /* so many surface points at most can be told apart */

#define KILN_ROW_LIGHTS 16u /* that a device gathers at once */

/* Threads of a point under so many lights: those of a workgroup are a multiple. */
#define KILN_ROW_LANES(lights) ((lights) > 8u ? KILN_ROW_LIGHTS : (lights) > 4u ? 8u : (lights) > 2u ? 4u : (lights))

#endif
