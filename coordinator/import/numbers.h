/* Table of the numbers in scene files and their ranges, and the one function that checks them. An importer refers to a
 * number by its row, so that no number is read without a range check.
 *
 * Ranges are those of the formats, if the formats define one. If a format has no limit, the range ends where values
 * computed from the number would no longer be finite; realistic values are far from it. Coordinates have a range of
 * their own, KILN_COORDINATE_MAX (assemble.h), and so have the settings of objects (object_settings.h). */
#ifndef KILN_COORDINATOR_IMPORT_NUMBERS_H
#define KILN_COORDINATOR_IMPORT_NUMBERS_H

#include <float.h>
#include <stdbool.h>

#include "coordinator/job/options.h"
#include "worker/base/vector.h"

#define KILN_NUMBER_LIST(ROW)                                                                                          \
    /* glTF: materials. Most factors are 0 to 1; a comment beside a row says why its range ends there. */              \
    ROW(BASE_COLOR, "baseColorFactor", 0.0, 1.0)                                                                       \
    ROW(DIFFUSE, "diffuseFactor", 0.0, 1.0)                                                                            \
    ROW(METALLIC, "metallicFactor", 0.0, 1.0)                                                                          \
    ROW(ROUGHNESS, "roughnessFactor", 0.0, 1.0)                                                                        \
    ROW(GLOSSINESS, "glossinessFactor", 0.0, 1.0)                                                                      \
    ROW(SPECULAR, "specularFactor", 0.0, 1.0)                                                                          \
    ROW(SPECULAR_COLOR, "specularColorFactor", 0.0, 1e6) /* 1 / F0 of an index of 1.002 */                             \
    ROW(IOR, "ior", 0.0, 1e3)                            /* Fresnel's equations use its fourth power; real: 4 */       \
    ROW(TRANSMISSION, "transmissionFactor", 0.0, 1.0)                                                                  \
    ROW(THICKNESS, "thicknessFactor", 0.0, 1e12)          /* m: KILN_COORDINATE_MAX */                                 \
    ROW(ATTENUATION, "attenuationDistance", 0.0, DBL_MAX) /* m: some files use FLT_MAX for "none" */                   \
    ROW(ATTENUATION_COLOR, "attenuationColor", 0.0, 1.0)                                                               \
    ROW(DISPERSION, "dispersion", 0.0, 1e3) /* 20 / Abbe number; real: 1 */                                            \
    ROW(CLEARCOAT, "clearcoatFactor", 0.0, 1.0)                                                                        \
    ROW(CLEARCOAT_ROUGHNESS, "clearcoatRoughnessFactor", 0.0, 1.0)                                                     \
    ROW(ANISOTROPY, "anisotropyStrength", 0.0, 1.0)                                                                    \
    ROW(ANISOTROPY_ROTATION, "anisotropyRotation", -1e6, 1e6) /* rad: floats beyond resolve no angles */               \
    ROW(EMISSIVE, "emissiveFactor", 0.0, KILN_LIGHT_MOST)                                                              \
    ROW(EMISSIVE_STRENGTH, "emissiveStrength", 0.0, KILN_LIGHT_MOST)                                                   \
    ROW(ALPHA_CUTOFF, "alphaCutoff", 0.0, 1e30) /* only used in a comparison */                                        \
    ROW(NORMAL_SCALE, "scale", -1e6, 1e6)                                                                              \
    ROW(TEXTURE_OFFSET, "offset", -1e6, 1e6)                                                                           \
    ROW(TEXTURE_SCALE, "scale", -1e6, 1e6)                                                                             \
    ROW(TEXTURE_ROTATION, "rotation", -1e6, 1e6) /* rad */                                                             \
    /* glTF: nodes; coordinates are checked again after multiplication by the matrices */                              \
    ROW(MATRIX, "matrix", -1e30, 1e30)                                                                                 \
    ROW(TRANSLATION, "translation", -1e30, 1e30)                                                                       \
    ROW(ROTATION, "rotation", -2.0, 2.0)                                                                               \
    ROW(SCALE, "scale", -1e30, 1e30)                                                                                   \
    ROW(WEIGHT, "weights", -1e6, 1e6)                                                                                  \
    /* glTF: lights, sky, cameras */                                                                                   \
    ROW(LIGHT_COLOR, "color", 0.0, KILN_LIGHT_MOST)                                                                    \
    ROW(LIGHT_INTENSITY, "intensity", 0.0, KILN_LIGHT_MOST)                                                            \
    ROW(LIGHT_RANGE, "range", 1e-15, 1e15) /* m: its square fits a float */                                            \
    ROW(INNER_CONE, "innerConeAngle", 0.0, KILN_PI / 2)                                                                \
    ROW(OUTER_CONE, "outerConeAngle", 0.0, KILN_PI / 2)                                                                \
    ROW(SKY_RADIANCE, "radiance", 0.0, KILN_LIGHT_MOST)                                                                \
    ROW(SUN_SKY_RADIANCE, "constant_sky_radiance", 0.0, KILN_LIGHT_MOST)                                               \
    ROW(YFOV, "yfov", 1e-6, KILN_PI - 1e-6)                                                                            \
    ROW(ASPECT, "aspectRatio", 1e-6, 1e6)                                                                              \
    ROW(XMAG, "xmag", -1e12, 1e12)                                                                                     \
    ROW(YMAG, "ymag", -1e12, 1e12)                                                                                     \
    /* MTL */                                                                                                          \
    ROW(MTL_DIFFUSE, "Kd", 0.0, 1.0)                                                                                   \
    ROW(MTL_EMISSION, "Ke", 0.0, KILN_LIGHT_MOST)                                                                      \
    ROW(MTL_ALPHA, "d", 0.0, 1.0)                                                                                      \
    ROW(MTL_TRANSPARENCY, "Tr", 0.0, 1.0)                                                                              \
    ROW(MTL_SPECULAR, "Ks", 0.0, 1.0)                                                                                  \
    ROW(MTL_FILTER, "Tf", 0.0, 1.0)                                                                                    \
    ROW(MTL_EXPONENT, "Ns", 0.0, 1e6)                                                                                  \
    ROW(MTL_IOR, "Ni", 0.0, 1e3)                                                                                       \
    ROW(MTL_ILLUM, "illum", 0.0, 10.0)                                                                                 \
    ROW(MTL_ROUGHNESS, "Pr", 0.0, 1.0)                                                                                 \
    ROW(MTL_METALLIC, "Pm", 0.0, 1.0)                                                                                  \
    ROW(MTL_CLEARCOAT, "Pc", 0.0, 1.0)                                                                                 \
    ROW(MTL_CLEARCOAT_ROUGHNESS, "Pcr", 0.0, 1.0)                                                                      \
    ROW(MTL_ANISOTROPY, "aniso", 0.0, 1.0)                                                                             \
    ROW(MTL_ANISOTROPY_ROTATION, "anisor", 0.0, 1.0)                                                                   \
    ROW(MTL_MAP_OFFSET, "-o", -1e6, 1e6)                                                                               \
    ROW(MTL_MAP_SCALE, "-s", -1e6, 1e6)                                                                                \
    /* product of any light numbers above, and texel of an environment image */                                        \
    ROW(LIGHT, "light", 0.0, KILN_LIGHT_MOST)

#define KILN_NUMBER_NAME(name, key, low, high) KILN_NUMBER_##name,
enum kiln_number { KILN_NUMBER_LIST(KILN_NUMBER_NAME) KILN_NUMBERS };

struct kiln_number_range {
    const char *key;  /* as it stands in the file */
    double low, high; /* both inclusive */
};

const struct kiln_number_range *kiln_number_range(enum kiln_number number);

/* Whether the value is finite and in the number's range. */
bool kiln_number_fits(enum kiln_number number, double value);

#endif
