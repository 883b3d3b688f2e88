#include "coordinator/bake/prepare/scene_survey.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "coordinator/bake/prepare/results_memory.h"
#include "worker/backend/backend.h"
#include "worker/base/memory.h"
#include "worker/light/lights.h"
#include "worker/pass/validity.h"
#include "worker/scene/texture.h"

static int import_scene(struct kiln_scene_survey *survey, const struct kiln_job *job, struct kiln_error *error)
{
    int status = kiln_temporary_make(&survey->temporary, error);
    if (status != KILN_OK)
        return status;
    status = kiln_scene_import_alone(&survey->import, job, survey->temporary.scene_file, NULL, error);
    return status != KILN_OK ? status : kiln_scene_open(&survey->scene, survey->temporary.scene_file, error);
}

static double world_area(const struct kiln_scene *scene, const struct kiln_object *object)
{
    const struct kiln_mesh *mesh = &scene->meshes[object->mesh];
    const struct kiln_vec3 *positions = scene->positions + mesh->vertex_first;
    const double *m = object->transform;
    double area = 0.0;
    for (uint64_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t *corner = scene->triangles + 3 * (mesh->triangle_first + t);
        const struct kiln_dvec3 p = dvec3_of(positions[corner[0]]);
        struct kiln_dvec3 edge[2];
        for (int e = 0; e < 2; e++) {
            const struct kiln_dvec3 d = dvec3_sub(dvec3_of(positions[corner[e + 1]]), p);
            edge[e] = dvec3(m[0] * d.x + m[1] * d.y + m[2] * d.z, m[4] * d.x + m[5] * d.y + m[6] * d.z,
                            m[8] * d.x + m[9] * d.y + m[10] * d.z);
        }
        area += 0.5 * dvec3_length(dvec3_cross(edge[0], edge[1]));
    }
    return area;
}

static uint64_t emissive_triangles(const struct kiln_scene *scene, const struct kiln_mesh *mesh)
{
    uint64_t count = 0;
    for (uint64_t t = mesh->triangle_first; t < mesh->triangle_first + mesh->triangle_count; t++) {
        const struct kiln_material *m = &scene->materials[scene->triangle_materials[t]];
        float mean[3];
        if (m->emission[0] + m->emission[1] + m->emission[2] == 0.0f)
            continue;
        kiln_triangle_mean_emission(scene, mesh, t, mean);
        count += mean[0] + mean[1] + mean[2] > 0.0f;
    }
    return count;
}

static int compare_doubles(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static int measure_objects(struct kiln_scene_survey *survey, struct kiln_error *error)
{
    const struct kiln_scene *scene = survey->scene;
    double *densities = NULL;
    uint64_t *emissive = NULL;
    size_t count = 0;
    int status;
    KILN_TRY(kiln_allocate(&survey->objects, scene->object_count, sizeof *survey->objects, "objects", error));
    KILN_TRY(kiln_allocate(&densities, scene->object_count, sizeof *densities, "densities", error));
    KILN_TRY(kiln_allocate(&emissive, scene->mesh_count, sizeof *emissive, "meshes", error));
    for (size_t m = 0; m < scene->mesh_count; m++)
        emissive[m] = emissive_triangles(scene, &scene->meshes[m]);
    for (size_t i = 0; i < scene->object_count; i++) {
        const struct kiln_object *object = &scene->objects[i];
        const struct kiln_mesh *mesh = &scene->meshes[object->mesh];
        struct kiln_scene_survey_object *o = &survey->objects[i];
        const double texels = (double)object->lightmap_width * (double)object->lightmap_height;
        survey->expanded += mesh->triangle_count;
        survey->emissive_triangles += emissive[object->mesh];
        survey->texels += (uint64_t)object->lightmap_width * object->lightmap_height;
        o->area = world_area(scene, object);
        if (o->area > 0.0)
            densities[count++] = o->density = sqrt(mesh->uv_area * texels / o->area);
    }
end:
    if (count > 0) {
        qsort(densities, count, sizeof *densities, compare_doubles);
        survey->density_min = densities[0];
        survey->density_median = densities[count / 2];
        survey->density_max = densities[count - 1];
    }
    kiln_free(&emissive);
    kiln_free(&densities);
    return status;
}

static void count_points(struct kiln_scene_survey *survey, const struct kiln_surface *surface)
{
    struct kiln_own_point point = {0};
    for (size_t f = 0; f < surface->tile_run_count; f++) {
        const struct kiln_tile_run *tile_run = &surface->tile_runs[f];
        struct kiln_scene_survey_object *object = &survey->objects[kiln_map_object(surface, tile_run->map)];
        /* backs have the same layout as fronts, so only fronts are looked at */
        if (kiln_map_back(surface, tile_run->map)) {
            point.at += tile_run->count;
            continue;
        }
        object->points += tile_run->count;
        for (uint32_t k = 0; k < tile_run->count; k++, point.at++)
            object->invalid += !kiln_point_valid(surface, point);
    }
    for (size_t i = 0; i < survey->scene->object_count; i++)
        survey->invalid += survey->objects[i].invalid;
}

/* Builds all surface points of the scene in this process, and runs the validity pass on them. */
static int find_points(struct kiln_scene_survey *survey, const struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_geometry *geometry = NULL;
    struct kiln_lights *lights = NULL;
    struct kiln_backend *backend = NULL;
    struct kiln_surface *surface = NULL;
    int status = kiln_geometry_create(&geometry, survey->scene, error);
    if (status == KILN_OK)
        status = kiln_lights_create(&lights, survey->scene, geometry, error);
    if (status == KILN_OK) {
        const struct kiln_backend_params params = {.scene = survey->scene,
                                                   .geometry = geometry,
                                                   .lights = lights,
                                                   .threads = job->machine.threads,
                                                   .instruction_set = job->machine.instruction_set,
                                                   .seed = job->light.seed};
        /* starting a GPU is not worth it for so little work */
        status = kiln_backend_create(&backend, "embree", &params, error);
    }
    if (status == KILN_OK) {
        const struct kiln_surface_params params = {.scene = survey->scene,
                                                   .geometry = geometry,
                                                   .cell_size = job->ranks.cell_size,
                                                   .ranks = 1,
                                                   .threads = job->machine.threads};
        status = kiln_surface_build(&surface, &params, &survey->surface, error);
    }
    if (status == KILN_OK)
        status = kiln_backend_set_surface(backend, surface, error);
    if (status == KILN_OK) {
        const struct kiln_batch all = {
            .count = surface->tile_run_count, .take = kiln_validity_keep, .context = surface};
        uint64_t rays = 0;
        status = kiln_backend_run(backend, &kiln_pass_validity, NULL, &all, &rays, error);
    }
    if (status == KILN_OK)
        count_points(survey, surface);
    if (status == KILN_OK)
        status = kiln_enclosed_lights_find(&survey->enclosed, &survey->enclosed_count, backend, error);
    kiln_backend_destroy(&backend);
    kiln_surface_destroy(&surface);
    kiln_lights_destroy(&lights);
    kiln_geometry_destroy(&geometry);
    return status;
}

int kiln_scene_survey_create(struct kiln_scene_survey **result, const struct kiln_job *job, struct kiln_error *error)
{
    struct kiln_scene_survey *survey = NULL;
    int status;
    KILN_TRY(kiln_allocate(&survey, 1, sizeof *survey, "the scene's figures", error));
    KILN_TRY(import_scene(survey, job, error));
    KILN_TRY(measure_objects(survey, error));
    KILN_TRY(kiln_points_memory_check(survey->scene, job, 1, 1, error));
    if (survey->expanded > 0)
        KILN_TRY(find_points(survey, job, error));
end:
    if (status != KILN_OK)
        kiln_scene_survey_destroy(&survey);
    *result = survey;
    return status;
}

void kiln_scene_survey_destroy(struct kiln_scene_survey **pointer)
{
    struct kiln_scene_survey *survey = *pointer;
    if (survey == NULL)
        return;
    kiln_scene_close(&survey->scene);
    kiln_temporary_remove(&survey->temporary);
    kiln_free(&survey->objects);
    kiln_free(&survey->enclosed);
    kiln_scene_import_release(&survey->import);
    kiln_free(pointer);
}
