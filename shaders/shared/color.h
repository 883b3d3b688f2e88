/* Luminance of linear RGB (weights of ITU-R BT.709), in the unit of the colour, such as W/m2. */
#ifndef KILN_SHADERS_SHARED_COLOR_H
#define KILN_SHADERS_SHARED_COLOR_H

#include "shaders/shared/language.h"
#ifndef KILN_GLSL
#    include "shaders/shared/real.h"
#endif

/* `ratio` is KILN_RATIO or KILN_RATIO32. */
#define KILN_RED_WEIGHT(ratio) ratio(2126, 10000)
#define KILN_GREEN_WEIGHT(ratio) ratio(7152, 10000)
#define KILN_BLUE_WEIGHT(ratio) ratio(722, 10000)

#ifdef KILN_GLSL /* real_luminance is in shaders/real.glsl */
float float_luminance(vec3 rgb)
{
    return dot(rgb,
               vec3(KILN_RED_WEIGHT(KILN_RATIO32), KILN_GREEN_WEIGHT(KILN_RATIO32), KILN_BLUE_WEIGHT(KILN_RATIO32)));
}
#else
/* Luminance of a colour in double. */
static inline double kiln_luminance(const double rgb[3])
{
    return KILN_RED_WEIGHT(KILN_RATIO) * rgb[0] + KILN_GREEN_WEIGHT(KILN_RATIO) * rgb[1] +
           KILN_BLUE_WEIGHT(KILN_RATIO) * rgb[2];
}
/* Luminance of a colour in float, calculated in double. */
static inline double kiln_luminance_of_floats(const float rgb[3])
{
    return KILN_RED_WEIGHT(KILN_RATIO) * (double)rgb[0] + KILN_GREEN_WEIGHT(KILN_RATIO) * (double)rgb[1] +
           KILN_BLUE_WEIGHT(KILN_RATIO) * (double)rgb[2];
}
/* Luminance of a colour in float, calculated in float, for millions of values. */
static inline float kiln_luminance_in_float(const float rgb[3])
{
    return KILN_RED_WEIGHT(KILN_RATIO32) * rgb[0] + KILN_GREEN_WEIGHT(KILN_RATIO32) * rgb[1] +
           KILN_BLUE_WEIGHT(KILN_RATIO32) * rgb[2];
}
#endif

#endif
