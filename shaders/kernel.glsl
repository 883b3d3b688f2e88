/* Beginning of every kernel. A kernel file reads
 *
 *     #version 460
 *     #extension GL_GOOGLE_include_directive : require
 *     #include "shaders/kernel.glsl"
 *     KILN_PUSH(struct of shaders/shared/push.h);
 *     void kiln_kernel(uint x, uint y) { ... }
 *     #include "shaders/main.glsl"
 *
 * Data is reached by address alone: KILN_ARRAY(Points, kiln_gpu_point, 4) makes a type, Points(push.points).at[i] an
 * element. Indices reach 2^31 - 1; beyond, add to the address in 64 bits. */
#extension GL_EXT_buffer_reference : require
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_shader_explicit_arithmetic_types_int64 : require
#ifdef KILN_PIPELINE
#    extension GL_EXT_ray_tracing : require
#endif

/* KILN_FLOAT64: lights and sums are stored as doubles (`stored`). They are also computed in doubles (`real`), except in
 * kernels with KILN_PLAIN, which leave cases that need double precision to other kernels. */
#ifdef KILN_FLOAT64
#    define stored double
#    define stored3 dvec3
#else
#    define stored float
#    define stored3 vec3
#endif
#if defined(KILN_FLOAT64) && !defined(KILN_PLAIN)
#    define KILN_DOUBLES
#    define real double
#else
#    define real float
#endif

#include "shaders/shared/layout.h"
#include "shaders/shared/push.h"
#include "shaders/shared/random.h"

/* These ids are the same in every kernel; a kernel's own constant has the id 6. */
layout(constant_id = 0) const uint TRAVERSAL = 0u;
layout(constant_id = 1) const uint HAS_ALPHA = 3u; /* KILN_PASSAGE_...: how surfaces may let light through */
layout(constant_id = 2) const uint HAS_SMOOTH = 1u;
layout(constant_id = 3) const uint LIGHT_KINDS = 0xffffffffu;
layout(constant_id = 4) const uint DRAW_AGAIN = 1u;
layout(constant_id = 5) const uint HAS_DIVIDED = 1u;    /* walls divide texels (worker/scene/surface.h) */
layout(constant_id = 7) const uint HAS_COINCIDENT = 1u; /* opposite faces coincide: KILN_COINCIDENT */
layout(constant_id = 8) const uint HAS_OCTREE = 0u;     /* the store is the octree, not the lightmap */
layout(constant_id = 9) const uint HAS_VARIED = 1u;     /* gloss is not the same all over (layout_material.h) */
layout(constant_id = 10) const uint HAS_GLOSSY = 0u;    /* gloss varies over a material (layout_material.h) */
layout(constant_id = 11) const uint HAS_BRUSHED = 1u;   /* some materials have gloss */
layout(constant_id = 12) const uint HAS_TRAPPED = 1u;   /* some have tables (struct kiln_bsdf_trapped_table) */
layout(constant_id = 13) const uint LOBE_KINDS = 0xffffffffu; /* KILN_BSDF_MAY_...: what materials may have */
layout(constant_id = 14) const uint TEXTURED = 0xffffffffu;   /* KILN_TEXTURED_...: what has textures */

/* `alignment` in bytes: 8 where the element has 64-bit members, else 4. */
#define KILN_ARRAY(Name, type, alignment)                                                                              \
    layout(buffer_reference, scalar, buffer_reference_align = alignment) buffer Name { type at[]; }

/* The kernel's push constants: push.scene and so on. */
#define KILN_PUSH(type)                                                                                                \
    layout(push_constant, scalar) uniform Push { type push; }

layout(buffer_reference, scalar, buffer_reference_align = 8) readonly buffer SceneRef { kiln_gpu_scene value; };
#define SCENE SceneRef(push.scene).value
