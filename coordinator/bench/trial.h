/* A trial: a small scene, made in a temporary folder and baked there by a kiln of its own, and its surface points with
 * their light. A bake that crashes ends that child only. */
#ifndef KILN_COORDINATOR_BENCH_TRIAL_H
#define KILN_COORDINATOR_BENCH_TRIAL_H

#include "coordinator/bench/child.h"
#include "coordinator/generate/glb.h"

struct kiln_trial_point {
    double position[3]; /* m, of the world */
    float direct[3], indirect[3], normal[3];
    float area; /* m2 */
    uint32_t object, texel[2];
    uint8_t valid;
};

struct kiln_trial {
    const struct kiln_job *job;
    char program[KILN_PATH_SIZE], folder[KILN_PATH_SIZE], scene[KILN_PATH_SIZE], result[KILN_PATH_SIZE];
    struct kiln_error *error;
    int status;           /* of the first call that failed in the scene that is made; kiln_trial_bake returns it */
    struct kiln_glb *glb; /* the scene that is made */
    size_t quads;         /* how many the scene has: objects 0, 1, ... of the bake */
    /* of the last bake */
    int code;                        /* its exit code */
    char said[KILN_CHILD_SAID];      /* what it wrote to stderr, as much as fits */
    json_t *report;                  /* run.json; NULL after another code than 0 */
    struct kiln_trial_point *points; /* by object, row and column */
    size_t point_count;
};

/* Makes the temporary folder, in $TMPDIR or /tmp. `job` has the options to pass on to the bakes. Release with
 * kiln_trial_end, also after a failure; it removes the folder. */
int kiln_trial_begin(struct kiln_trial *trial, const struct kiln_job *job, struct kiln_error *error);
void kiln_trial_end(struct kiln_trial *trial);

/* ---- the scene ---- */

/* Begins a new, empty scene. */
void kiln_trial_scene(struct kiln_trial *trial);
/* Adds a diffuse material, and returns its number. */
uint32_t kiln_trial_material(struct kiln_trial *trial, double albedo, double radiance);
/* Adds a mesh of `count` corners, whose lightmap layout is `layout`, and a node that places it (NULL: as it is). */
void kiln_trial_mesh(struct kiln_trial *trial, const struct kiln_vec3 *corners, const struct kiln_vec2 *layout,
                     size_t count, const uint32_t *indices, size_t index_count, uint32_t material,
                     const struct kiln_glb_placement *placement);
/* Adds a parallelogram, corners counter-clockwise seen from its front; its lightmap is full. It is cut from corner
 * `cut` to the opposite one. */
void kiln_trial_quad(struct kiln_trial *trial, const struct kiln_dvec3 corner[4], unsigned cut, uint32_t material,
                     const struct kiln_glb_placement *placement);
void kiln_trial_light(struct kiln_trial *trial, double intensity, struct kiln_dvec3 position);

/* ---- the bake ---- */

/* Writes the scene and bakes it with `options`, words that end with NULL, and with the options of the job, which win.
 * KILN_OK whatever the bake's exit code: see `code`, `said`, `report` and `points`. KILN_STOPPED if a signal asked for
 * the end. */
int kiln_trial_bake(struct kiln_trial *trial, const char *const *options);
/* The mean of a channel (direct and indirect light) over an object by area, green. */
double kiln_trial_mean(const struct kiln_trial *trial, uint32_t object);
/* Whether the bake's stderr, or a note in run.json, has these words. */
bool kiln_trial_says(const struct kiln_trial *trial, const char *words);

#endif
