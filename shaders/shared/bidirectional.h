/* The bidirectional pass (worker/pass/bidirectional.h): what both backends share of it beside the weights. */
#ifndef KILN_SHADERS_SHARED_BIDIRECTIONAL_H
#define KILN_SHADERS_SHARED_BIDIRECTIONAL_H

#include "shaders/shared/bidirectional_weights.h"
#include "shaders/shared/path.h"

/* With the seed's upper half, in place of it: paths of light draw other numbers than the camera's. */
#define KILN_LIGHT_PATH_SEED 0x6c696774u

/* The same of the paths from surface points (worker/pass/reference.h), whose own numbers hang on it too. */
#define KILN_REFERENCE_LIGHT_SEED 0x6c697266u

/* The numbers of a path's first ray have the uses of a surface that no path has: which light; the place; the direction.
 */
#define KILN_EMISSION_USE 0x40000000u

/* Paths of light sample no lights: these numbers of a surface choose the place on the lens that it is connected to. */
#define KILN_LENS_USE KILN_PATH_LIGHT

#endif
