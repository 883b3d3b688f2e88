/* The export child: how kiln export calls it, and its two tasks. Private to coordinator/export.
 *
 * argv: PROGRAM export-child SOURCE SCENE_FILE OUTPUT
 *       SOURCE is "" if the export is made from kiln's own scene file alone.
 *
 * Standard input is trusted, since kiln writes it: one JSON object and a zero byte; if coordinates have moved, a struct
 * kiln_vec2 for each vertex of the scene; if there is light at vertices, three floats for each vertex of each object.
 * The JSON object is:
 *   {"objects": [LINK or null, one per object], "root": ROOT, "drop_baked_lights": false, "has_coordinates": false,
 *    "has_light": false}
 * LINK becomes extensions.KILN_lightmap of the object's node (the child fills in texCoord); ROOT becomes that extension
 * of the file's root. */
#ifndef KILN_COORDINATOR_EXPORT_CHILD_H
#define KILN_COORDINATOR_EXPORT_CHILD_H

#include "coordinator/export/glb_build.h"
#include "coordinator/import/confine.h"
#include "coordinator/confined/confined.h"
#include "worker/scene/scene.h"

enum { KILN_EXPORT_CHILD_ARGUMENTS = 5 };

struct kiln_export_task {
    const char *source, *scene_file, *output; /* output: for sentences only */
    struct kiln_scene *scene;
    char *input; /* everything read from standard input */
    json_t *plan;
    const struct kiln_vec2 *coordinates; /* per vertex: lightmap coordinates */
    const float (*light)[3];             /* per vertex of each object: irradiance; NULL: none */
};

/* Writes the source's glTF, with TEXCOORD_1 as baked and the plan's links, to the descriptor KILN_CHILD_OUTPUT.
 * `mapped`: as in struct kiln_confine. KILN_BAD_INPUT when the source is not the one that was baked. */
int kiln_export_gltf(const struct kiln_export_task *task, void (*mapped)(const struct kiln_confine *),
                     struct kiln_error *error);

/* Writes the glTF from the scene file alone, for sources that are not glTF. Exports material properties as far as kiln
 * keeps them; textures as PNG. */
int kiln_export_own(const struct kiln_export_task *task, struct kiln_error *error);

/* Writes likewise the part and place that object `first` begins, to the open, empty `file`: its objects with what they
 * use, its lights and cameras. The plan's "objects" are those of the place alone. */
int kiln_export_own_place(const struct kiln_export_task *task, size_t first, int file, struct kiln_error *error);

/* Sets a material's metallic-roughness numbers and extensions from its gloss. Texture indices are the scene's; `set` is
 * the number of the TEXCOORD with texcoord_gloss. glTF has no Phong: a Phong material gets the roughness of an equally
 * wide lobe. */
void kiln_export_gloss(struct kiln_glb_build *b, json_t *material, const struct kiln_gloss *gloss, int set);

/* Runs the confined child that writes a scene with its lightmaps (child.c); not a command for users. argv as it was
 * spawned. Returns its exit status. */
int kiln_export_child(int argc, char **argv);

#endif
