/* Scene survey for `kiln info` and `kiln check`: the imported scene, its surface points, and statistics of each object.
 */
#ifndef KILN_COORDINATOR_BAKE_PREPARE_SCENE_SURVEY_H
#define KILN_COORDINATOR_BAKE_PREPARE_SCENE_SURVEY_H

#include "coordinator/bake/points/enclosed_lights.h"
#include "coordinator/job/job.h"
#include "coordinator/files/temporary.h"
#include "coordinator/bake/prepare/import_scene.h"
#include "coordinator/surface/surface_build.h"

struct kiln_scene_survey_object {
    double area;    /* in the world, m2 */
    double density; /* texels per metre: the square root of (texels that the layout covers / area) */
    uint64_t points, invalid;
};

struct kiln_scene_survey {
    struct kiln_temporary temporary;
    struct kiln_scene_import import;
    struct kiln_scene *scene;
    struct kiln_surface_report surface; /* all zero if the scene has no triangles */
    struct kiln_scene_survey_object *objects;
    uint64_t expanded;           /* triangles with instances expanded */
    uint64_t emissive_triangles; /* instances expanded; triangles whose mean emission is not zero */
    uint64_t texels;             /* of all lightmaps */
    uint64_t invalid;            /* surface points inside other geometry, which a bake fills from their neighbours */
    struct kiln_enclosed_light *enclosed;
    size_t enclosed_count;
    double density_min, density_median, density_max; /* over objects; 0 if there are none */
};

/* Imports the scene of the job into a temporary file, builds its surface points and finds the invalid ones. Not
 * collective, does not use MPI. Destroy with kiln_scene_survey_destroy, which removes the temporary file. */
int kiln_scene_survey_create(struct kiln_scene_survey **survey, const struct kiln_job *job, struct kiln_error *error);
void kiln_scene_survey_destroy(struct kiln_scene_survey **survey);

#endif
