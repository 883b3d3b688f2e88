/* What `kiln info` and `kiln check` know of a scene: the imported scene, its surface points, and figures for each
 * object. */
#ifndef KILN_COORDINATOR_BAKE_SCENE_SURVEY_H
#define KILN_COORDINATOR_BAKE_SCENE_SURVEY_H

#include "coordinator/job/job.h"
#include "coordinator/files/temporary.h"
#include "coordinator/import/import.h"
#include "coordinator/surface/surface_build.h"

struct kiln_scene_survey_object {
    double area;    /* m2 in the world */
    double density; /* texels per metre: the square root of (texels that the layout covers / area) */
    uint64_t points, invalid;
};

struct kiln_scene_survey {
    struct kiln_temporary temporary;
    struct kiln_import_report import;
    struct kiln_scene *scene;
    struct kiln_surface_report surface; /* all zero when nothing has a triangle */
    struct kiln_scene_survey_object *objects;
    uint64_t expanded;           /* triangles with instances expanded */
    uint64_t emissive_triangles; /* expanded; those whose mean emission is not zero */
    uint64_t texels;             /* of all lightmaps */
    uint64_t invalid;            /* surface points inside other geometry, filled from their neighbours by a bake */
    double density_min, density_median, density_max; /* over objects; 0 without any */
};

/* Imports the job's scene into a temporary file, builds its surface points and finds the invalid ones. Not collective,
 * no MPI. Destroy with kiln_scene_survey_destroy, which removes the temporary file. */
int kiln_scene_survey_create(struct kiln_scene_survey **look, const struct kiln_job *job, struct kiln_error *error);
void kiln_scene_survey_destroy(struct kiln_scene_survey **look);

#endif
