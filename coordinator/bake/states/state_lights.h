/* The lights of a state (kiln relight --states, --listen), and the direct light of parts of them, which is kept.
 *
 * What of a scene gives light are its elements: each light, each material that emits, the environment. Up to
 * KILN_STATE_PARTS elements are a part each; where there are more, each part has some. Of a part the direct light is
 * traced once, alone, with all samples that the bake has. A state's direct light is the sum of its parts', scaled by
 * channel; of a part whose elements do not change alike, those that do are a part of their own, for that state. An
 * element that has moved, turned or is new has no other light to scale: it is traced. So what parts a state has hangs
 * on the baked scene and on that state alone.
 *
 * Where no light is changed, direct light is that of all lights together, as the bake traces it: the same bits. */
#ifndef KILN_COORDINATOR_BAKE_STATES_STATE_LIGHTS_H
#define KILN_COORDINATOR_BAKE_STATES_STATE_LIGHTS_H

#include "coordinator/bake/bake_private.h"
#include "coordinator/integrate/relight/states.h"

enum { KILN_STATE_PARTS = 16 };

/* Lights, materials and environment: copies of a scene's arrays, which may differ from it. */
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

/* Collective. The prepared scene, its lights and its backend have these lights and colours from now on. Borrows the
 * copy. KILN_SYSTEM. */
int kiln_state_scene_use(struct kiln_prepared *prepared, const struct kiln_state_scene *copy, struct kiln_error *error);

struct kiln_state_lights;

/* Collective. `base`: the scene as it is baked; borrowed. KILN_SYSTEM. */
int kiln_state_lights_create(struct kiln_state_lights **lights, struct kiln_bake *bake, struct kiln_states *states,
                             const struct kiln_state_scene *base, struct kiln_error *error);
void kiln_state_lights_destroy(struct kiln_state_lights **lights);

/* The direct light of a state: parts, and by what they are scaled. */
struct kiln_state_mix;
/* Collective. Traces what is not kept, by the room of states, whose solutions are lost. Fills in what the state's
 * settings, emission and direct light are; valid until as many further states as `states` has room for were mixed.
 * KILN_SYSTEM. */
int kiln_state_lights_mix(struct kiln_state_lights *lights, const struct kiln_state_scene *scene, size_t place,
                          struct kiln_state *state, struct kiln_error *error);
/* Whether direct light of the state mixed at `place` is the bake's own, and how many parts it has. */
bool kiln_state_lights_same(const struct kiln_state_lights *lights, size_t place, size_t *parts);

/* Parts that were traced so far, and the bytes of all that is kept. */
void kiln_state_lights_counts(const struct kiln_state_lights *lights, uint64_t *traced, uint64_t *bytes);

#endif
