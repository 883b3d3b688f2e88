/* Scene data on the device that paths and chains need, and other kernels do not. */
#include "worker/backend/vulkan/vulkan.h"
#include "worker/base/memory.h"
#include "worker/scene/footprint.h"

/* Sets each edge's lift, on the side that has one. */
static void set_lift(const struct kiln_scene *scene, const struct kiln_geometry *g, uint32_t triangle, float lift[3])
{
    static const int edges[3] = {0, 1, 3};
    struct kiln_lift of;
    for (int back = 0; back < 2; back++)
        if (kiln_triangle_lift(scene, g, triangle, back == 1, &of))
            for (int e = 0; e < 3; e++)
                lift[e] += back == 1 ? -of.at[edges[e]] : of.at[edges[e]];
}

static struct kiln_gpu_path_triangle triangle_of(const struct kiln_scene *scene, const struct kiln_geometry *g,
                                                 uint32_t triangle)
{
    const struct kiln_hit_record *record = &g->records[triangle];
    const struct kiln_object *object = &scene->objects[record->object];
    struct kiln_vec3 corner[3];
    kiln_geometry_corners(g, triangle, corner);
    struct kiln_gpu_path_triangle t = {.p = corner[0],
                                       .e1 = vec3_sub(corner[1], corner[0]),
                                       .e2 = vec3_sub(corner[2], corner[0]),
                                       .normal = kiln_triangle_exact_normal(scene, g, triangle)};
    t.offset = kiln_offset_distance(g, triangle, t.normal);
    if ((scene->meshes[object->mesh].flags & KILN_MESH_SMOOTH) != 0) {
        t.flags |= KILN_GPU_PATH_SMOOTH;
        t.shading0 = kiln_triangle_shading_normal(scene, g, triangle, 0.0f, 0.0f);
        t.shading1 = kiln_triangle_shading_normal(scene, g, triangle, 1.0f, 0.0f);
        t.shading2 = kiln_triangle_shading_normal(scene, g, triangle, 0.0f, 1.0f);
        set_lift(scene, g, triangle, t.lift);
    }
    if ((object->flags & KILN_OBJECT_CASTER_ONLY) != 0 && (record->material & KILN_RECORD_EMITS) == 0)
        t.flags |= KILN_GPU_PATH_HIDDEN;
    return t;
}

static int upload_triangles(struct vulkan_backend *b, struct kiln_error *error)
{
    const struct kiln_geometry *g = b->params.geometry;
    struct kiln_gpu_path_triangle *triangles = NULL;
    int status = kiln_allocate(&triangles, g->triangle_count, sizeof *triangles, "the triangles of paths", error);
    if (status == KILN_OK) {
#pragma omp parallel for schedule(static) num_threads((int)b->threads)
        for (size_t i = 0; i < g->triangle_count; i++)
            triangles[i] = triangle_of(b->params.scene, g, (uint32_t)i);
        status = gpu_buffer_of(b->gpu, &b->path_triangles, triangles, g->triangle_count * sizeof *triangles,
                               "the triangles of paths", error);
        b->layout.path_triangles = b->path_triangles.address;
    }
    kiln_free(&triangles);
    return status;
}

int vulkan_surfaces(struct vulkan_backend *b, struct kiln_error *error)
{
    int status = KILN_OK;
    if (b->all_materials && b->path_triangles.size > 0)
        return KILN_OK;
    if (!b->all_materials) {
        vulkan_materials_destroy(b->gpu, &b->materials);
        b->all_materials = true;
        KILN_TRY(vulkan_materials_create(b->gpu, &b->params, true, &b->materials, &b->layout.materials, error));
    }
    if (b->path_triangles.size == 0)
        KILN_TRY(upload_triangles(b, error));
    KILN_TRY(vulkan_upload_root(b, error));
end:
    return status;
}
