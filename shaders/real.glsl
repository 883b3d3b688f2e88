/* Functions of `real`, the type of light computations: double or float (see shaders/kernel.glsl).
 *
 * GLSL has no trigonometric functions of doubles, and Vulkan guarantees little precision for those of floats (acos:
 * 4,096 ulp). So both are computed here: by Taylor series after reduction to a quarter turn, and by Newton's method
 * from the float value. Absolute errors are below 1e-15 in double for angles up to a few turns, 3e-7 in float.
 *
 * Constants are written as real(1.5LF): folded at compile time, so that the float variant contains no doubles. */
#ifndef KILN_REAL_GLSL
#define KILN_REAL_GLSL

#include "shaders/shared/color.h"
#include "shaders/shared/real.h"

#ifdef KILN_DOUBLES
#    define real3 dvec3
const real KILN_REAL_TINY = real(2.2250738585072014e-308LF);
const real KILN_REAL_BELOW_ONE = real(0.99999999999999988897769753748LF); /* 1 - 2^-53 */
#else
#    define real3 vec3
const real KILN_REAL_TINY = real(1.17549435e-38LF);
const real KILN_REAL_BELOW_ONE = real(0.999999940395355224609375LF); /* 1 - 2^-24 */
#endif

const real KILN_REAL_PI = real(3.14159265358979323846LF);
#define KILN_INFINITY uintBitsToFloat(0x7f800000u)

/* Centre of the 2^-32 interval of a fraction; strictly inside (0, 1). */
real real_unit(uint fraction)
{
    return min((real(fraction) + real(0.5LF)) * real(2.3283064365386962890625e-10LF), KILN_REAL_BELOW_ONE);
}

/* Sine and cosine of x, a few turns at most. */
void float_sincos(float x, out float sine, out float cosine)
{
    const float quarters = floor(x * 0.636619772 + 0.5);
    const float r = ((x - quarters * 1.5703125) - quarters * 4.837512969970703125e-4) - quarters * 7.549789948768648e-8;
    const float r2 = r * r;
    const float s = r + r * r2 * (-1.66666667e-1 + r2 * (8.33333333e-3 + r2 * (-1.98412698e-4 + r2 * 2.75573192e-6)));
    const float c = 1.0 + r2 * (-0.5 + r2 * (4.16666667e-2 + r2 * (-1.38888889e-3 + r2 * 2.48015873e-5)));
    const int quadrant = int(quarters) & 3;
    const float a = (quadrant & 1) == 0 ? s : c, b = (quadrant & 1) == 0 ? c : s;
    sine = (quadrant & 2) == 0 ? a : -a;
    cosine = quadrant == 1 || quadrant == 2 ? -b : b;
}

/* Angle of (x, y) from the x axis, -pi to pi; 0 at the origin. */
float float_atan2(float y, float x)
{
    const float larger = max(abs(x), abs(y));
    if (!(larger > 0.0))
        return 0.0;
    const float scale = 1.0 / larger;
    x *= scale;
    y *= scale;
    const float first = atan(y, x);
    float sine, cosine;
    float_sincos(first, sine, cosine);
    const float off = (y * cosine - x * sine) / (x * cosine + y * sine);
    return first + off * (1.0 - off * off * 0.333333333);
}

/* The same of `real`. */
#ifdef KILN_DOUBLES
#    include "shaders/shared/sine.h"

void real_sincos(real x, out real sine, out real cosine)
{
    const real quarters = floor(x * 0.63661977236758134308LF + 0.5LF);
    const real r = (x - quarters * 1.57079632679489655800LF) - quarters * 6.12323399573676603587e-17LF;
    const real r2 = r * r, s = kiln_sine_series(r, r2), c = kiln_cosine_series(r2);
    const int quadrant = int(quarters) & 3;
    const real a = (quadrant & 1) == 0 ? s : c, b = (quadrant & 1) == 0 ? c : s;
    sine = (quadrant & 2) == 0 ? a : -a;
    cosine = quadrant == 1 || quadrant == 2 ? -b : b;
}

real real_atan2(real y, real x)
{
    const real larger = max(abs(x), abs(y));
    if (!(larger > 0))
        return 0;
    const real scale = 1 / larger; /* what floats hold */
    x *= scale;
    y *= scale;
    const real first = real(atan(float(y), float(x)));
    real sine, cosine;
    real_sincos(first, sine, cosine);
    const real off = (y * cosine - x * sine) / (x * cosine + y * sine);
    return first + off * (1 - off * off * 0.33333333333333333333LF);
}
#else
#    define real_sincos float_sincos
#    define real_atan2 float_atan2
#endif

/* Arc cosine of x in -1 .. 1. */
real real_acos(real x) { return real_atan2(sqrt(max(real(0), (1 - x) * (1 + x))), x); }

/* Arc sine likewise. */
real real_asin(real x) { return real_atan2(x, sqrt(max(real(0), (1 - x) * (1 + x)))); }

/* Unit vector along a; the zero vector stays zero. */
real3 real_unit_vector(real3 a)
{
    const real squared = dot(a, a);
    return squared > 0 ? a * (1 / sqrt(squared)) : a;
}

real real_luminance(real3 rgb)
{
    return dot(rgb, real3(KILN_RED_WEIGHT(KILN_RATIO), KILN_GREEN_WEIGHT(KILN_RATIO), KILN_BLUE_WEIGHT(KILN_RATIO)));
}

#endif
