/* Lights of a state (kiln relight --states, --listen), and a cache of the direct light of parts of them.
 *
 * The elements of a scene are its sources of light: each light, each emitting material, the environment. Up to
 * KILN_STATE_TERMS elements are a part each; if there are more, each part has several. The direct light of each part is
 * traced once, alone, with all samples of the bake. A state's direct light is the sum of the direct light of its parts,
 * scaled by channel. If the elements of a part change differently, those that change alike form a part of their own,
 * for that state. An element that is moved, turned or new has no kept light to scale: it is traced. So the parts of a
 * state depend only on the baked scene and on that state.
 *
 * Where no light is changed, direct light is traced for all lights together, as in the bake: the same bits. */
#ifndef KILN_COORDINATOR_BAKE_STATES_STATE_LIGHTS_H
#define KILN_COORDINATOR_BAKE_STATES_STATE_LIGHTS_H

#include "coordinator/bake/bake_private.h"
#include "coordinator/integrate/relight/states.h"

enum { KILN_STATE_TERMS = 16 };

/* Lights, materials and environment of a state: modified copies of the scene's arrays. */
struct kiln_state_scene {
    struct kiln_light *lights;
    struct kiln_material *materials;
    struct kiln_environment environment;
};
/* Copies of the scene's. KILN_SYSTEM. */
int kiln_state_scene_create(struct kiln_state_scene *copy, const struct kiln_scene *scene, struct kiln_error *error);
void kiln_state_scene_release(struct kiln_state_scene *copy);
void kiln_state_scene_copy(struct kiln_state_scene *to, const struct kiln_state_scene *from,
                           const struct kiln_scene *scene);

/* Collective. Replaces the lights and colours of the prepared scene, its lights and its backend by those of the copy,
 * which is borrowed. KILN_SYSTEM. */
int kiln_state_scene_use(struct kiln_prepared *prepared, const struct kiln_state_scene *copy, struct kiln_error *error);

struct kiln_state_lights;

/* Collective. `base`: the scene as it is baked; borrowed. KILN_SYSTEM. */
int kiln_state_lights_create(struct kiln_state_lights **lights, struct kiln_bake *bake, struct kiln_states *states,
                             const struct kiln_state_scene *base, struct kiln_error *error);
void kiln_state_lights_destroy(struct kiln_state_lights **lights);

/* The direct light of a state: parts and their scale factors. */
struct kiln_state_mix;
/* Collective. Traces the parts that are not cached; this uses the memory of the states, whose solutions are lost. Fills
 * in the settings, emission and direct light of the state. They stay valid until as many further states as `states` has
 * room for were mixed. KILN_SYSTEM. */
int kiln_state_lights_mix(struct kiln_state_lights *lights, const struct kiln_state_scene *scene, size_t place,
                          struct kiln_state *state, struct kiln_error *error);
/* Whether the direct light of the state at `place` equals the bake's own; *parts becomes its number of parts. */
bool kiln_state_lights_same(const struct kiln_state_lights *lights, size_t place, size_t *parts);

/* Counts the parts traced so far, and the bytes of all cached direct light. */
void kiln_state_lights_counts(const struct kiln_state_lights *lights, uint64_t *traced, uint64_t *bytes);

#endif
