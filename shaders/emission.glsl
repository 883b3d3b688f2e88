/* Beginning of light paths: declarations that shaders/shared/emission.h needs. Needs shaders/lights.glsl and BOTH
 * (shaders/bidirectional.glsl). */
KILN_ARRAY(TreeWords, uint, 4);

#define KILN_EMISSION_DIRECTIONAL(emission) (BOTH.lights - 1u - SCENE.lights.directional_count)
#define KILN_EMISSION_ENVIRONMENT(emission) (BOTH.lights - 1u)
#define KILN_EMISSION_CENTRE(emission) real3(BOTH.centre)
#define KILN_EMISSION_RADIUS(emission) real(BOTH.sphere)
#define kiln_emission_chance(light) real(LightReals(BOTH.chances).at[light])
#define kiln_emission_up_to(light) real(LightReals(BOTH.up_to).at[light])
#define kiln_emission_parent(node) TreeWords(BOTH.parents).at[node]
#define kiln_emission_leaf(light) TreeWords(BOTH.leaves).at[light]

#include "shaders/shared/emission.h"

uint emission_directional(uint i) { return KILN_EMISSION_DIRECTIONAL(emission) + i; }
uint emission_environment() { return KILN_EMISSION_ENVIRONMENT(emission); }
