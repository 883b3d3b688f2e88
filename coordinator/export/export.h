/* Exports the scene with its lightmaps for engines: a .glb with the source scene (materials, textures, cameras, lights,
 * extras and extensions as they were), the lightmap coordinates as baked, and a link on every baked node.
 *
 * A link is the same object in the node's extensions.KILN_lightmap and in extras.kiln_lightmap:
 *   {"file": "lightmaps/NAME.exr", "page": 0, "texCoord": 1, "scale": [1, 1], "offset": [0, 0],
 *    "quantity": "irradiance", "unit": "W/m2", "encoding": "exr", "source": {"node": 3, "mesh": 2}}
 * - file: relative to the .glb.
 * - page: index in the root's list.
 * - texCoord, scale, offset: the coordinate on the page is TEXCOORD_texCoord * scale + offset, v down, as in glTF.
 * - range: with rgbm only, the value that 1 x 1 stands for.
 * - source: indices in the source; absent if that is not glTF.
 *
 * A node with EXT_mesh_gpu_instancing has {"instances": [link or null, one per instance]}. Where the backs of a
 * double-sided surface have a lightmap, the link has "back": {"file", and "range" if any}, for the same coordinates.
 * The root's extensions.KILN_lightmap is {"version": 1, "pages": [{"file", "width", "height", "encoding"}, ...]}. The
 * extension is listed as used, never as required. Nodes of lights whose light is in the lightmaps have
 * extras.kiln_baked = true. Coordinates go to TEXCOORD_1 or, if a texture uses that one, to the first free set.
 *
 * Irradiance at vertices, where it is given, is COLOR_1 (float, linear RGB). Then every object that is placed by a node
 * has a mesh of its own, which shares all other attributes; instances (EXT_mesh_gpu_instancing) have none. glTF counts
 * colours without gaps, so a primitive without COLOR_0 gets a white one.
 *
 * The source comes from outside: it is read again in a confined child (child.h), and must be the file that was baked,
 * byte for byte. Nothing here is collective. */
#ifndef KILN_COORDINATOR_EXPORT_EXPORT_H
#define KILN_COORDINATOR_EXPORT_EXPORT_H

#include <jansson.h>
#include <stdbool.h>

#include "worker/base/stop.h"
#include "worker/scene/scene.h"

/* The lightmap of one object. */
struct kiln_link {
    const char *file;  /* relative to the .glb; NULL: the object has no lightmap */
    const char *back;  /* the file for its backs, with the same coordinates; NULL: none */
    double back_range; /* as in struct kiln_page_info */
    uint32_t page;
    double scale[2], offset[2];
};

struct kiln_page_info {
    const char *file; /* relative to the .glb */
    uint32_t width, height;
    double range; /* rgbm: the value that 1 x 1 stands for; 0: the encoding has none */
};

struct kiln_export_params {
    const char *source;     /* the glTF file that was baked; NULL: the .glb is made from the scene file alone */
    const char *scene_file; /* path of `scene` */
    const struct kiln_scene *scene;
    const char *directory, *output; /* where the .glb goes (coordinator/files/publish.h) */
    const char *unit;               /* unit of the lightmaps: "W/m2" or "lx" */
    const char *encoding;           /* of the pages: "exr", ... */
    const struct kiln_link *links;  /* one per object */
    const struct kiln_page_info *pages;
    size_t page_count;
    const struct kiln_vec2 *coordinates; /* per vertex of the scene, instead of texcoord_lightmap; NULL: use that */
    /* irradiance at the vertices of each object's mesh, for one object after the other; NULL: none */
    const float (*light)[3];
    bool drop_baked_lights;
    const struct kiln_stop *stop; /* borrowed; NULL: none. When asked, returns KILN_STOPPED and leaves no file */
};

/* Writes the .glb under a temporary name, syncs it and renames it. KILN_BAD_INPUT: the source is not the one that was
 * baked, or cannot be written again; KILN_NO_INPUT: it no longer exists; KILN_CANNOT_CREATE, KILN_IO, KILN_SYSTEM. */
int kiln_export_scene(const struct kiln_export_params *params, struct kiln_error *error);

/* Whether the scene was imported from glTF, so that it can be exported from its source. */
bool kiln_export_has_gltf(const struct kiln_scene *scene);

/* Whether an object's lightmap is among the results. */
bool kiln_export_is_published(const struct kiln_scene *scene, size_t object);

/* The sum over all objects of the number of vertices of their meshes. */
uint64_t kiln_export_vertices(const struct kiln_scene *scene);

/* Estimate of the size in bytes of a scene's .glb. */
uint64_t kiln_export_size(const struct kiln_scene *scene);

/* Writes DIRECTORY/scene.glb for a bake's own lightmaps. `path`: the source, as given to the bake. has_back[object]:
 * the bake also has a lightmap of the object's backs; has_back may be NULL. `light`: as in the params. */
int kiln_export_beside(const char *directory, const char *path, const struct kiln_scene *scene, const uint8_t *has_back,
                       const float (*light)[3], const char *unit, const struct kiln_stop *stop,
                       struct kiln_error *error);

/* Writes DIRECTORY/scenes/PLACE.glb for each part and place of a scene in parts that has objects, with links to
 * ../lightmaps/PLACE/OBJECT.exr: those of this rank, which is every `ranks`-th from the `rank`-th on. The scene has
 * been checked, so no child is started. `scene`, `has_back`, `light`, `unit`, `stop`: as above. KILN_BAD_INPUT if a
 * file would exceed 4 GiB. */
struct kiln_export_places {
    const char *directory;
    const struct kiln_scene *scene;
    const uint8_t *has_back;
    const float (*light)[3];
    const char *unit;
    const struct kiln_stop *stop;
    uint32_t rank, ranks;
};
int kiln_export_places(const struct kiln_export_places *params, struct kiln_error *error);

#endif
