/* Lightmap layouts and sizes: uses a mesh's second UV set where it is valid, unwraps the mesh otherwise, and decides
 * the size of each object's lightmap. */
#ifndef KILN_COORDINATOR_LAYOUT_LAYOUT_H
#define KILN_COORDINATOR_LAYOUT_LAYOUT_H

#include "coordinator/scene/builder.h"

/* Zero means default in every field. */
struct kiln_layout_params {
    const char *scene; /* begins sentences; borrowed */
    double texels_max; /* of all lightmaps together; 0: any */
    /* 0: automatic: the whole scene gets about `texels` texels, or more where charts need more distance */
    double texels_per_metre;
    double texels;          /* with automatic density; default 2^18 */
    uint32_t lightmap_size; /* every lightmap is N x N texels; 0: sizes follow the density */
    uint32_t lightmap_max;  /* largest side, texels; default 4096 */
    uint32_t padding;       /* texels between charts; default 2, enough for bilinear filtering */
    bool repack;            /* pack the charts of a valid UV set anew where they lie less than two texels apart */
    bool keep_shared;       /* keep a valid UV set although its charts share texels */
};

/* Makes the layouts and sets the lightmap sizes of all objects in the builder.
 *
 * For each mesh: checks the second UV set (inside 0..1, finite, not collapsed, no overlap between triangles beyond
 * rounding at chart seams). Where it fails or is absent, unwraps the mesh: segments by normal and connectivity, planar
 * charts with bounded stretch, packed with padding; vertices are duplicated where charts meet. For each object: sets
 * lightmap_width and lightmap_height. Fills mesh.uv_area, surface_area and KILN_MESH_UNWRAPPED. Adds notes that say why
 * a UV set was refused. Deterministic.
 *
 * With automatic density, an object with its file's layout gets a higher density if that separates its charts by two
 * texels (padding.h) along all but 1 % of their borders: up to four times the common density, as long as the scene
 * stays below four times `texels`, and no object exceeds twice the density of the largest one (density.h). The largest
 * object is raised first, then objects where an added texel separates the most border. If charts still lie closer, a
 * note says in how many lightmaps, along how much of the borders, and which density would be enough; the scene header's
 * padding_factor also stores the latter.
 *
 * The lightmaps are refused before any is rasterised (KILN_BAD_INPUT or KILN_USAGE, with the largest object, its
 * density and the remedy) if they have more than `texels_max` texels, or if settings of the file itself
 * (object_settings.h) ask for more than 2^25 and for more than 16 times as many as the user's options alone.
 *
 * If charts of a valid UV set share texels at the object's lightmap size (sharing.h), light of one chart would appear
 * on the other, and be reflected by it. Unless `keep_shared`, such a mesh's charts are packed anew (kiln_repack), and a
 * note says so. */
int kiln_layout(struct kiln_builder *builder, const struct kiln_layout_params *params, struct kiln_error *error);

/* Checks the second UV sets of all meshes ahead of kiln_layout, which then takes those without a flaw as they are
 * (KILN_LIGHTMAP_UV_SOUND, mesh.uv_area). The others it checks again, to say what is wrong. For parts of a scene, whose
 * scene files keep the answer. KILN_SYSTEM. */
int kiln_layout_judge(struct kiln_builder *builder, struct kiln_error *error);

/* Sets up stores that need no layouts: every lightmap is one texel, and all coordinates in it are 0. Fills
 * mesh.surface_area and KILN_MESH_NO_LAYOUT, and the header's density: `texels_per_metre` or, if 0, the density that
 * gives the whole scene about 2^18 texels. */
int kiln_layout_none(struct kiln_builder *builder, double texels_per_metre, struct kiln_error *error);

#endif
