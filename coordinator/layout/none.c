#include "coordinator/layout/layout.h"

#include <math.h>
#include <string.h>

enum { AUTOMATIC_TEXELS = 1 << 18 };

static struct kiln_dvec3 turned(const double m[12], struct kiln_dvec3 p)
{
    return dvec3(m[0] * p.x + m[1] * p.y + m[2] * p.z, m[4] * p.x + m[5] * p.y + m[6] * p.z,
                 m[8] * p.x + m[9] * p.y + m[10] * p.z);
}

/* Area of a mesh under the linear part of a transform, m2. */
static double area_of(const struct kiln_builder *builder, const struct kiln_mesh *mesh, const double transform[12])
{
    const struct kiln_vec3 *p =
        KILN_BUILDER_DATA(builder, struct kiln_vec3, KILN_SECTION_POSITIONS) + mesh->vertex_first;
    const uint32_t *corner =
        KILN_BUILDER_DATA(builder, uint32_t, KILN_SECTION_TRIANGLES) + 3 * (size_t)mesh->triangle_first;
    double area = 0.0;
    for (uint64_t t = 0; t < mesh->triangle_count; t++, corner += 3) {
        const struct kiln_dvec3 o = dvec3_of(p[corner[0]]);
        area += 0.5 * dvec3_length(dvec3_cross(turned(transform, dvec3_sub(dvec3_of(p[corner[1]]), o)),
                                               turned(transform, dvec3_sub(dvec3_of(p[corner[2]]), o))));
    }
    return area;
}

int kiln_layout_none(struct kiln_builder *builder, double texels_per_metre, struct kiln_error *error)
{
    static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    struct kiln_mesh *meshes = KILN_BUILDER_DATA(builder, struct kiln_mesh, KILN_SECTION_MESHES);
    struct kiln_object *objects = KILN_BUILDER_DATA(builder, struct kiln_object, KILN_SECTION_OBJECTS);
    const size_t vertices = builder->sections[KILN_SECTION_TEXCOORD_LIGHTMAP].count;
    double area = 0.0;
    (void)error;
    for (size_t m = 0; m < builder->sections[KILN_SECTION_MESHES].count; m++) {
        meshes[m].surface_area = area_of(builder, &meshes[m], identity);
        meshes[m].uv_area = 0.0;
        meshes[m].flags |= KILN_MESH_NO_LAYOUT;
    }
    for (size_t o = 0; o < builder->sections[KILN_SECTION_OBJECTS].count; o++) {
        objects[o].lightmap_width = objects[o].lightmap_height = 1;
        area += area_of(builder, &meshes[objects[o].mesh], objects[o].transform);
    }
    if (vertices > 0)
        memset(builder->sections[KILN_SECTION_TEXCOORD_LIGHTMAP].data, 0, vertices * sizeof(struct kiln_vec2));
    if (!(texels_per_metre > 0.0))
        texels_per_metre = area > 0.0 ? sqrt(AUTOMATIC_TEXELS / area) : 1.0;
    builder->texels_per_metre = (float)texels_per_metre;
    return KILN_OK;
}
