/* The scene with its lightmaps, as engines take it: a .glb that is the source scene (materials, textures, cameras,
 * lights, extras and extensions as they were) plus the lightmap's coordinates as baked, and a link on every baked node.
 *
 * A link is the same object as the node's extensions.KILN_lightmap and as extras.kiln_lightmap:
 *   {"file": "lightmaps/NAME.exr", "page": 0, "texCoord": 1, "scale": [1, 1], "offset": [0, 0], "quantity":
 * "irradiance", "unit": "W/m2", "encoding": "exr", "source": {"node": 3, "mesh": 2}} file: relative to the .glb; page:
 * its place in the root's list; a page's coordinate is TEXCOORD_texCoord * scale + offset, v down, as in glTF; range:
 * with rgbm, what 1 x 1 stands for; source: indices in the source, left out where that is no glTF. A node with
 * EXT_mesh_gpu_instancing has {"instances": [link or null, one an instance]}. Where the backs of a double-sided surface
 * have a lightmap, the link has "back": {"file", and "range" where there is one}, for the same coordinates. The root's
 * extensions.KILN_lightmap is {"version": 1, "pages": [{"file", "width", "height", "encoding"}, ...]}. The extension is
 * used, never required. Nodes of lights that are in the lightmaps have extras.kiln_baked = true. Coordinates go to
 * TEXCOORD_1, or to the first free set where a texture uses that one.
 *
 * The source is what somebody else wrote: it is read again in a confined child (child.h), and has to be the file that
 * was baked, byte for byte. Nothing here is collective. */
#ifndef KILN_COORDINATOR_EXPORT_EXPORT_H
#define KILN_COORDINATOR_EXPORT_EXPORT_H

#include <jansson.h>
#include <stdbool.h>

#include "worker/base/stop.h"
#include "worker/scene/scene.h"

/* Where an object's lightmap is. */
struct kiln_link {
    const char *file;  /* relative to the .glb; NULL: the object has none */
    const char *back;  /* of its backs, with the same coordinates; NULL: none */
    double back_range; /* as struct kiln_page_info's */
    uint32_t page;
    double scale[2], offset[2];
};

struct kiln_page_info {
    const char *file; /* relative to the .glb */
    uint32_t width, height;
    double range; /* 0: the encoding has none */
};

struct kiln_export_params {
    const char *source;     /* the glTF that was baked; NULL: the .glb is made from the scene file alone */
    const char *scene_file; /* path of `scene` */
    const struct kiln_scene *scene;
    const char *directory, *output; /* the place of the .glb (coordinator/files/publish.h) */
    const char *unit;               /* of the lightmaps: "W/m2" or "lx" */
    const char *encoding;           /* of the pages: "exr", ... */
    const struct kiln_link *links;  /* one an object */
    const struct kiln_page_info *pages;
    size_t page_count;
    const struct kiln_vec2 *coordinates; /* a vertex of the scene, in place of texcoord_lightmap; NULL: that */
    bool drop_baked_lights;
    const struct kiln_stop *stop; /* borrowed; NULL: none. KILN_STOPPED then, and nothing is left */
};

/* Writes the .glb aside, syncs it and renames it. KILN_BAD_INPUT: the source is not the one that was baked, or cannot
 * be written again; KILN_NO_INPUT: it is gone; KILN_CANNOT_CREATE, KILN_IO, KILN_SYSTEM. */
int kiln_export_scene(const struct kiln_export_params *params, struct kiln_error *error);

/* Whether the scene was read from glTF, and so can be exported from its source. */
bool kiln_export_has_gltf(const struct kiln_scene *scene);

/* Whether an object's lightmap is among the results. */
bool kiln_export_is_published(const struct kiln_scene *scene, size_t object);

/* About how many bytes the .glb of a scene will have. */
uint64_t kiln_export_size(const struct kiln_scene *scene);

/* DIRECTORY/scene.glb beside a bake's own lightmaps, from the source `path` (the scene as it was given to the bake).
 * has_back[object] (or NULL): the bake has a lightmap of the object's backs, too. */
int kiln_export_beside(const char *directory, const char *path, const struct kiln_scene *scene, const uint8_t *has_back,
                       const char *unit, const struct kiln_stop *stop, struct kiln_error *error);

#endif
