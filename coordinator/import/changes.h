/* Applies changes of lights, materials and sky (coordinator/job/changes.h) to the scene under construction. */
#ifndef KILN_COORDINATOR_IMPORT_CHANGES_H
#define KILN_COORDINATOR_IMPORT_CHANGES_H

#include "coordinator/scene/builder.h"

/* Parts of a scene that change. Borrowed. */
struct kiln_changeable {
    const char *strings;
    struct kiln_light *lights;
    struct kiln_material *materials;
    size_t light_count, material_count;
};

/* `text`: JSON; NULL or "": none. KILN_USAGE for a key that is none, a value out of its range, and a pattern that
 * matches nothing. Of lights and materials, once the scene is read; it checks all keys. */
int kiln_changes_apply(struct kiln_builder *builder, const char *text, struct kiln_error *error);
/* And of the environment, once that is set; its keys have been checked. */
void kiln_changes_apply_environment(struct kiln_builder *builder, const char *text);

/* The same, of lights and materials that stand anywhere, and of an environment. */
int kiln_changes_apply_to(const struct kiln_changeable *scene, const char *text, struct kiln_error *error);
void kiln_changes_apply_to_environment(struct kiln_environment *environment, const char *text);

/* Publishes DIR/scene.kscene: the open scene's file with other lights, materials and environment, of which `before` is
 * what it has. `hash`: of the new file's content. Not collective. KILN_SYSTEM, KILN_IO, KILN_CANNOT_CREATE. */
int kiln_changes_write_scene(const struct kiln_scene *scene, const struct kiln_changeable *before,
                             const struct kiln_changeable *now, const struct kiln_environment *environment,
                             const char *directory, uint64_t hash[2], struct kiln_error *error);

#endif
