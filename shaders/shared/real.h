/* Number types for light calculations in the language layer; for the rest see shaders/shared/language.h. C calculates
 * in double, GLSL in `real`, which is double or float (shaders/kernel.glsl). A vector's components are .x, .y and .z in
 * both.
 *
 * A constant with a fraction is KILN_RATIO(a, b), the number nearest to a / b, both integers: GLSL writes decimal
 * fractions of doubles with a suffix that C does not have.
 *
 * GLSL's real_sincos, real_atan2, real_acos and real_asin are in shaders/real.glsl: kernels include that file before
 * the headers that need this one. */
#ifndef KILN_SHADERS_SHARED_REAL_H
#define KILN_SHADERS_SHARED_REAL_H

#include "shaders/shared/language.h"

#ifdef KILN_GLSL

#    define kiln_real real
#    ifdef KILN_DOUBLES
#        define kiln_real3 dvec3
#    else
#        define kiln_real3 vec3
#    endif
#    define kiln_real_of(x) real(x)
#    define KILN_RATIO(a, b) (real(a) / real(b))
#    define real3_make(x, y, z) kiln_real3(x, y, z)
#    define real3_add(a, b) ((a) + (b))
#    define real3_sub(a, b) ((a) - (b))
#    define real3_scale(a, s) ((a) * (s))
#    define real3_dot(a, b) dot(a, b)
#    define real3_cross(a, b) cross(a, b)
#    define real3_length(a) length(a)
#    define real_max(a, b) max(a, b)
#    define real_min(a, b) min(a, b)
#    define real_clamp(x, low, high) clamp(x, low, high)
#    define real_abs(x) abs(x)
#    define real_sqrt(x) sqrt(x)
#    define real_floor(x) floor(x)
#    define real_is_infinite(x) isinf(x)
#    define real3_differ(a, b) ((a) != (b))
#    define real3_negate(a) (-(a))
#    define real3_normalize(a) normalize(a)
#    define KILN_DEVICE_UNIT(a) real_unit_vector(a) /* normalises again; C accepts rounding errors */
#    define KILN_REAL_INFINITE real(KILN_INFINITY)
#    define KILN_REAL_RGB(name) kiln_real3 name /* a colour, name[0] to name[2] */
/* Values in memory, and differences of them (shaders/kernel.glsl) */
#    define kiln_stored stored
#    define kiln_stored3 stored3
#    define stored3_negate(a) (-(a))
#    define stored3_sub(a, b) ((a) - (b))
#    define stored3_dot(a, b) dot(a, b)
#    define KILN_TO_STORED3(a) stored3(a)
#    define KILN_TO_REAL3(a) kiln_real3(a)
#    define KILN_TO_VECTOR(a) vec3(a)
#    define KILN_OF_VECTOR(a) kiln_real3(a)

#else

#    include <float.h>

typedef double kiln_real;
typedef struct kiln_dvec3 kiln_real3;
typedef double kiln_stored;
typedef struct kiln_dvec3 kiln_stored3;
#    define kiln_real_of(x) ((double)(x))
#    define KILN_RATIO(a, b) ((double)(a) / (double)(b))
#    define KILN_REAL_PI KILN_PI
#    define KILN_REAL_TINY DBL_MIN
#    define KILN_REAL_BELOW_ONE (1.0 - 0x1p-53)
#    define real3_make dvec3
#    define real3_add dvec3_add
#    define real3_sub dvec3_sub
#    define real3_scale dvec3_scale
#    define real3_dot dvec3_dot
#    define real3_cross dvec3_cross
#    define real3_length dvec3_length
#    define real_max fmax
#    define real_min fmin
#    define real_clamp(x, low, high) fmax(low, fmin(high, x))
#    define real_abs fabs
#    define real_sqrt sqrt
#    define real_floor floor
#    define real_is_infinite(x) isinf(x)
#    define real3_negate(a) dvec3_scale(a, -1.0)
#    define KILN_DEVICE_UNIT(a) (a)
#    define KILN_REAL_INFINITE ((double)INFINITY)
#    define KILN_REAL_RGB(name) kiln_real name[3]
#    define stored3_sub dvec3_sub
#    define stored3_dot dvec3_dot
#    define stored3_negate(a) dvec3_scale(a, -1.0)
#    define KILN_TO_STORED3(a) (a)
#    define KILN_TO_REAL3(a) (a)
#    define KILN_TO_VECTOR(a) vec3_of(a)
#    define KILN_OF_VECTOR(a) dvec3_of(a)
#    define real_atan2 atan2
#    define real_acos acos
#    define real_asin asin
static inline void real_sincos(double x, double *sine, double *cosine)
{
    *sine = sin(x);
    *cosine = cos(x);
}
static inline bool real3_differ(kiln_real3 a, kiln_real3 b) { return a.x != b.x || a.y != b.y || a.z != b.z; }
static inline kiln_real3 real3_normalize(kiln_real3 a) { return dvec3_scale(a, 1.0 / dvec3_length(a)); }
/* Unit vector along a; the zero vector stays zero. */
static inline kiln_real3 real_unit_vector(kiln_real3 a)
{
    const double length = dvec3_length(a);
    return length > 0.0 ? dvec3_scale(a, 1.0 / length) : a;
}

#endif

#endif
