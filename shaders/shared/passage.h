/* Transmission of light through surfaces, and the random decision whether a partly transparent surface is hit. */
#ifndef KILN_SHADERS_SHARED_PASSAGE_H
#define KILN_SHADERS_SHARED_PASSAGE_H

#include "shaders/shared/fresnel.h"
#include "shaders/shared/random.h"

/* Strongest effect on light that a scene's non-opaque triangles have, for which a backend has to be prepared. */
#define KILN_PASSAGE_NONE 0u  /* all triangles are opaque */
#define KILN_PASSAGE_MASK 1u  /* holes: every position lets all light through, or none */
#define KILN_PASSAGE_BLEND 2u /* a fraction of the light, the same for all colours */
#define KILN_PASSAGE_TINT 3u  /* a fraction of the light that depends on colour */
#define KILN_PASSAGE_PANE 4u  /* and on the angle: panes of glass, which reflect */

/* Optical depth, -log2 of the transmitted share, at which light counts as none. */
#define KILN_DEPTH_MOST 48

/* A pane: a thin smooth wall of glass. Light goes straight through it, less what it reflects. As for thin walls in
 * shaders/shared/bsdf.h, the reflectance of one interface stands for both faces. `eta` 0: no pane, no reflection. */
struct kiln_pane {
    float eta;      /* index of refraction; else >= 1 */
    float specular; /* KHR_materials_specular, */
    float color;    /* largest channel of the specular colour */
    float coat;     /* strength of a clear coat, of index 1.5; on both faces, as on the thin walls above */
};

/* Share of light that a pane transmits at an angle with this cosine, 0 to 1, before the base colour tints it. */
KILN_FUNCTION float kiln_pane_share(KILN_STRUCT kiln_pane pane, float cosine)
{
    if (pane.eta == 0.0f)
        return 1.0f;
    const float exact = kiln_fresnel(cosine, pane.eta), normal = kiln_fresnel_normal(pane.eta);
    const float coat = pane.coat > 0.0f ? pane.coat * kiln_fresnel(cosine, KILN_COAT_INDEX) : 0.0f;
    return (1.0f - kiln_fresnel_scaled(pane.specular, exact, normal, pane.color)) * (1.0f - coat);
}

/* Decides by chance whether a surface of this opacity is hit: by a hash of the ray's seed and the triangle. */
KILN_FUNCTION bool kiln_is_there(KILN_U32 seed, KILN_U32 triangle, float opacity)
{
    return KILN_TO_F32(kiln_hash2(seed, triangle) >> 8) * KILN_RATIO32(1, 16777216) < opacity;
}

/* Share of a material's surface that is present, from its alpha; `mode` is one of KILN_ALPHA_... */
#define KILN_ALPHA_OPAQUE 0u
#define KILN_ALPHA_MASK 1u
#define KILN_ALPHA_BLEND 2u
KILN_FUNCTION float kiln_coverage(KILN_U32 mode, float cutoff, float alpha)
{
    return mode == KILN_ALPHA_OPAQUE ? 1.0f : mode == KILN_ALPHA_MASK ? (alpha >= cutoff ? 1.0f : 0.0f) : alpha;
}

#endif
