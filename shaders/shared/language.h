/* Language layer: macros with which C and GLSL both compile the other headers of shaders/shared.
 *
 * A shared function is written in the common subset of both languages: declarations, arithmetic, if, for, calls. Macros
 * below stand for constructs that differ. KILN_GLSL is defined in GLSL. The number type of light calculations,
 * kiln_real, and its functions are in shaders/shared/real.h, separately, since kernels that do not use it must not see
 * a double.
 *
 * Arrays are accessed by macros, too. KILN_LOAD(lights, areas, i) is &lights->areas[i] in C, where functions get the
 * struct as a parameter (KILN_CONTEXT, KILN_PASS). In GLSL it is kiln_lights_areas(i), a function that knows the
 * array's address.
 *
 * Both languages give the same bits for formulas with only sums, products, quotients and square roots of doubles, in
 * the written order. Differences arise from transcendental functions (the C library's in C, those of shaders/real.glsl
 * in GLSL), from floats in place of doubles, and from a GPU that contracts a product and a sum.
 *
 * Code that is written separately, because the form of one language would change results or speed of the other:
 *
 *   - the volume of a spherical triangle: divisions in C, reciprocals in GLSL (spherical_triangle.h)
 *   - sines and cosines: C's library; range reduction of angles, in C's lanes and in GLSL (area_light_sampler.c,
 *     real.glsl)
 *   - cosine-distributed directions of the bounce pass: C adds them up axis by axis of the world, GLSL along the
 *     tangents (embree/rays.c, hemisphere.glsl)
 *   - choices among lights: a list in C, recomputed on demand in GLSL to save registers (lights.c,
 *     light_choices.glsl); the cut through the light tree is written once (lights.h)
 *   - flux of emitted rays: a factor over the density, one quotient in GLSL and three in C (emitted.h, aims.h)
 *   - visible sides of a target's box: C stores them, GLSL recomputes them (targets.c, box_seen.glsl)
 *   - texture coordinates: doubles in C, fixed point in GLSL (texture.c, material.glsl)
 *   - vertex colours and samples of footprints: bytes and polygons in C, floats and triangles in GLSL
 *   - rotation of highlights by a texture: a product in C, quotients in GLSL (gloss.h)
 *   - transmittance of several surfaces: sums of optical depths in Embree's filters and in the ray-tracing pipeline, a
 *     product in the compute kernels (passage.c, trace/payload.glsl, trace/alpha.glsl)
 *
 * tests/unit/test_shared.c, test_vulkan_lights.c, test_vulkan_materials.c, test_vulkan_probes.c and test_vulkan_bsdf.c
 * compare both sides.
 */
#ifndef KILN_SHADERS_SHARED_LANGUAGE_H
#define KILN_SHADERS_SHARED_LANGUAGE_H

#ifdef GL_core_profile

#    define KILN_GLSL
#    define KILN_CONTEXT(type, name)           /* parameter: the struct whose arrays the function reads */
#    define KILN_PASS(context)                 /* argument for KILN_CONTEXT */
#    define KILN_CONTEXT_IS(type, name, value) /* local variable in its place */
#    define KILN_GET(context, member) (KILN_CONTEXT_##context.member)        /* scalar member of the struct */
#    define KILN_LOAD(context, array, index) kiln_##context##_##array(index) /* element of its arrays */
#    define KILN_ITEM(type) type                                             /* type of such an element */
#    define KILN_RGB(name) vec3 name                                         /* a colour, name[0] to name[2]; */
#    define KILN_RGB_IN(name) vec3 name                                      /* a parameter; */
#    define KILN_RGB_OUT(name) out vec3 name                                 /* output parameter */
#    define KILN_U32 uint                                                    /* an unsigned number of 32 bits */
#    define KILN_U64 uint64_t            /* unsigned number of 64 bits; GLSL needs an extension */
#    define KILN_I32 int                 /* a signed one */
#    define KILN_VECTOR vec3             /* three floats; vec3(x, y, z) makes one in both languages */
#    define KILN_FUNCTION                /* before every function */
#    define KILN_STRUCT                  /* before the name of a struct that is used as a type */
#    define KILN_IN(type) type           /* input struct, by address in C */
#    define KILN_OUT(type) out type      /* output parameter, by address in C */
#    define KILN_INOUT(type) inout type  /* parameter that is read and changed */
#    define KILN_AT(parameter) parameter /* value of these three in the function */
#    define KILN_TO(variable) variable   /* argument for these three */
#    define KILN_TO_U32(x) uint(x)       /* conversions */
#    define KILN_TO_U64(x) uint64_t(x)
#    define KILN_TO_I32(x) int(x)
#    define KILN_TO_F32(x) float(x)
#    define KILN_RATIO32(a, b) (float(a) / float(b)) /* the float nearest to a / b, both integers */
#    define float_min(a, b) min(a, b)
#    define float_max(a, b) max(a, b)
#    define float_abs(a) abs(a)
#    define float_sqrt(a) sqrt(a)
#    define float_exp(a) exp(a)
#    define float_log(a) log(a)
#    define float_pow(a, b) pow(a, b)
#    define vec3_add(a, b) ((a) + (b))
#    define vec3_sub(a, b) ((a) - (b))
#    define vec3_mul(a, b) ((a) * (b))
#    define vec3_scale(a, s) ((a) * (s))
#    define vec3_madd(a, b, s) ((a) + (b) * (s))
#    define vec3_dot(a, b) dot(a, b)
#    define vec3_length(a) length(a)
#    define vec3_normalize(a) normalize(a)
#    define vec3_cross(a, b) cross(a, b)
#    define KILN_LENGTH2(x, y) length(vec2(x, y))
#    define KILN_CONSTANT const /* before a table */
#    define word_min(a, b) min(a, b)
#    define word_max(a, b) max(a, b)
#    define integer_clamp(i, low, high) clamp(i, low, high)

#else

#    include <math.h>
#    include <stdbool.h>
#    include <stdint.h>

#    include "shaders/shared/vector.h"

#    define KILN_CONTEXT(type, name) const struct type *name,
#    define KILN_PASS(context) context,
#    define KILN_CONTEXT_IS(type, name, value) const struct type *name = value
#    define KILN_GET(context, member) ((context)->member)
#    define KILN_LOAD(context, array, index) (&(context)->array[index])
#    define KILN_ITEM(type) struct type *
#    define KILN_RGB(name) float name[3]
#    define KILN_RGB_IN(name) const float name[3]
#    define KILN_RGB_OUT(name) float name[3]
#    define KILN_U32 uint32_t
#    define KILN_U64 uint64_t
#    define KILN_I32 int32_t
#    define KILN_FUNCTION static inline
#    define KILN_STRUCT struct
#    define KILN_IN(type) const type *
#    define KILN_OUT(type) type *
#    define KILN_INOUT(type) type *
#    define KILN_AT(a) (*(a))
#    define KILN_TO(x) (&(x))
#    define KILN_TO_U32(x) ((uint32_t)(x))
#    define KILN_TO_U64(x) ((uint64_t)(x))
#    define KILN_TO_I32(x) ((int32_t)(x))
#    define KILN_TO_F32(x) ((float)(x))
#    define KILN_VECTOR struct kiln_vec3
#    define KILN_RATIO32(a, b) ((float)(a) / (float)(b))
#    define float_min fminf
#    define float_max fmaxf
#    define float_abs fabsf
#    define float_sqrt sqrtf
#    define float_exp expf
#    define float_log logf
#    define float_pow powf
#    define KILN_LENGTH2(x, y) sqrtf((x) * (x) + (y) * (y))
#    define KILN_CONSTANT static const
static inline uint32_t word_min(uint32_t a, uint32_t b) { return a < b ? a : b; }
static inline uint32_t word_max(uint32_t a, uint32_t b) { return a > b ? a : b; }
static inline int32_t integer_clamp(int32_t i, int32_t low, int32_t high)
{
    return i < low ? low : i > high ? high : i;
}

#endif

#define KILN_INVERSE_PI 0.31830988618379067f /* 1 / pi, in float */
#define KILN_FLOAT_TINY 1.0e-20f             /* keeps a quotient from being 0 / 0 */

#endif
