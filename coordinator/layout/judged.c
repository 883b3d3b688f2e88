#include "coordinator/layout/layout.h"
#include "coordinator/layout/uv_check.h"

int kiln_layout_judge(struct kiln_builder *builder, struct kiln_error *error)
{
    struct kiln_mesh *meshes = KILN_BUILDER_DATA(builder, struct kiln_mesh, KILN_SECTION_MESHES);
    const struct kiln_vec3 *positions = KILN_BUILDER_DATA(builder, const struct kiln_vec3, KILN_SECTION_POSITIONS);
    const struct kiln_vec2 *uv = KILN_BUILDER_DATA(builder, const struct kiln_vec2, KILN_SECTION_TEXCOORD_LIGHTMAP);
    const uint32_t *triangles = KILN_BUILDER_DATA(builder, const uint32_t, KILN_SECTION_TRIANGLES);
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && i < builder->sections[KILN_SECTION_MESHES].count; i++) {
        struct kiln_mesh *mesh = &meshes[i];
        struct kiln_uv_verdict verdict = {.valid = false};
        if (mesh->triangle_count == 0 || builder->mesh_has_lightmap_uv[i] == KILN_LIGHTMAP_UV_NONE)
            continue;
        status = kiln_uv_check(&verdict, positions + mesh->vertex_first, uv + mesh->vertex_first,
                               triangles + 3 * mesh->triangle_first, mesh->triangle_count, error);
        if (status != KILN_OK || !verdict.valid || verdict.warning[0] != '\0')
            continue;
        builder->mesh_has_lightmap_uv[i] = KILN_LIGHTMAP_UV_SOUND;
        mesh->uv_area = verdict.uv_area;
    }
    return status;
}
