/* How kiln export talks to its confined child, and the parts of that child. Private to coordinator/export.
 *
 * argv: PROGRAM export-child SOURCE SCENE_FILE OUTPUT [SOURCE is "" where the export is made from kiln's own scene file
 * alone] standard input, one JSON object (ours, trusted): and, where coordinates have moved, a zero byte and a struct
 * kiln_vec2 for each vertex of the scene:
 *   {"objects": [LINK or null, one an object], "root": ROOT, "drop_baked_lights": false}
 * LINK is what the node of an object gets as extensions.KILN_lightmap (texCoord is settled by the child), ROOT what the
 * file itself gets. */
#ifndef KILN_COORDINATOR_EXPORT_CHILD_H
#define KILN_COORDINATOR_EXPORT_CHILD_H

#include "coordinator/export/glb_build.h"
#include "coordinator/import/confine.h"
#include "coordinator/confined/confined.h"
#include "worker/scene/scene.h"

enum { KILN_EXPORT_CHILD_ARGUMENTS = 5 };
#define KILN_LIGHTMAP_EXTENSION "KILN_lightmap"

struct kiln_export_task {
    const char *source, *scene_file, *output; /* output: for sentences */
    struct kiln_scene *scene;
    char *input; /* all of standard input */
    json_t *plan;
    const struct kiln_vec2 *coordinates; /* a vertex: the lightmap's */
};

/* The source's glTF with TEXCOORD_1 as baked and the plan's links, written to the descriptor KILN_CHILD_OUTPUT.
 * `mapped` as in struct kiln_confine. KILN_BAD_INPUT when the source is not the one that was baked. */
int kiln_export_gltf(const struct kiln_export_task *task, void (*mapped)(const struct kiln_confine *),
                     struct kiln_error *error);

/* The same from the scene file alone: for sources that are no glTF. Materials as far as kiln keeps them, textures as
 * PNG. */
int kiln_export_own(const struct kiln_export_task *task, struct kiln_error *error);

/* Puts `link` (borrowed) on a node: extensions.KILN_lightmap, and the same as extras.kiln_lightmap where extras is an
 * object or absent. */
void kiln_export_link(struct kiln_glb_build *b, json_t *node, json_t *link);
/* The root's extension, and the extension's name among those used. */
void kiln_export_root(struct kiln_glb_build *b, json_t *plan);

/* Not a command for users: the confined child that writes a scene with its lightmaps (child.c). argv as it was spawned.
 * Returns its exit status. */
int kiln_export_child(int argc, char **argv);

#endif
