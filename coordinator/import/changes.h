/* Applies changes of lights, materials and sky (coordinator/job/changes.h) to the scene under construction. */
#ifndef KILN_COORDINATOR_IMPORT_CHANGES_H
#define KILN_COORDINATOR_IMPORT_CHANGES_H

#include "coordinator/scene/builder.h"

/* The parts of a scene that changes can modify. Borrowed. */
struct kiln_changeable {
    const char *strings;
    struct kiln_light *lights;
    struct kiln_material *materials;
    size_t light_count, material_count;
};

/* Applies changes of lights and materials, once the scene is read; also checks all keys. `text`: JSON; NULL or "": no
 * changes. KILN_USAGE for an unknown key, a value out of its range, and a pattern that matches nothing. */
int kiln_changes_apply(struct kiln_builder *builder, const char *text, struct kiln_error *error);
/* Applies changes of the environment, once it is set; the keys have been checked already. */
void kiln_changes_apply_environment(struct kiln_builder *builder, const char *text);

/* Apply changes likewise to lights and materials stored anywhere, and to an environment. */
int kiln_changes_apply_to(const struct kiln_changeable *scene, const char *text, struct kiln_error *error);
void kiln_changes_apply_to_environment(struct kiln_environment *environment, const char *text);

/* Publishes DIR/scene.kscene: the open scene's file with the lights and materials of `now`, and with `environment`.
 * `before` has the scene's present lights and materials. `hash`: of the new file's content. Not collective.
 * KILN_SYSTEM, KILN_IO, KILN_CANNOT_CREATE. */
int kiln_changes_write_scene(const struct kiln_scene *scene, const struct kiln_changeable *before,
                             const struct kiln_changeable *now, const struct kiln_environment *environment,
                             const char *directory, uint64_t hash[2], struct kiln_error *error);

#endif
