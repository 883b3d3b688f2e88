/* Private to kiln bench crossover. */
#ifndef KILN_COORDINATOR_BENCH_CROSSOVER_PRIVATE_H
#define KILN_COORDINATOR_BENCH_CROSSOVER_PRIVATE_H

#include "coordinator/bench/child.h"
#include "coordinator/view/view.h"

enum { KILN_CROSSOVER_VIEWS = 4, KILN_CROSSOVER_WIDTH = 128, KILN_CROSSOVER_HEIGHT = 72 };
enum { KILN_FULL_WIDTH = 1920, KILN_FULL_HEIGHT = 1080 }; /* that times are told for */
enum { KILN_LARGE_WIDTH = 960, KILN_LARGE_HEIGHT = 540 }; /* of views from lightmaps, for their time */

struct kiln_cost {
    double processor, clock; /* s */
};

/* A way of drawing the views: how far from the reference they are. */
struct kiln_crossover_way {
    uint32_t samples;       /* paths a pixel; 0: from lightmaps */
    double distance;        /* from the reference, rms of t */
    double error;           /* the same without the reference's own */
    double nrmse;           /* of radiance, relative to its mean; the reference's own error is in it */
    struct kiln_cost views; /* of the process that drew the small views */
};

struct kiln_crossover {
    struct kiln_job *job;
    char program[KILN_PATH_SIZE], bake[KILN_PATH_SIZE], said[KILN_PATH_SIZE], keys[KILN_PATH_SIZE];
    uint32_t reference_samples;
    bool device; /* a GPU does the work: the clock judges */
    struct kiln_crossover_way lightmaps, few, many;
    struct kiln_cost large; /* of the process that drew the large views from lightmaps */
    /* results */
    double exponent, factor;               /* error of n paths = factor n^-exponent */
    double reference_error;                /* rms of t */
    double paths;                          /* a pixel that have the bake's error, at least 1 */
    struct kiln_cost bake_cost;            /* of the whole bake */
    struct kiln_cost view_cost, path_cost; /* of a view at full size */
    double users, users_clock;             /* from so many views on the bake costs less; INFINITY: never */
};

/* crossover_views.c. Chooses KILN_CROSSOVER_VIEWS cameras, the same for every run: places half-way from surfaces along
 * their normals to what is opposite, from where no back of a surface is seen and little of the outside, each looking
 * level into the direction where it sees farthest, and seeing light there, by a few paths. Writes them to `path` as key
 * frames (camera_path.h). KILN_BAD_INPUT if the scene has too few such places. */
int kiln_crossover_views(const char *bake, const char *path, struct kiln_error *error);

/* crossover_tell.c. Writes crossover.csv and crossover.svg, and prints the result. */
int kiln_crossover_tell(const struct kiln_crossover *c, struct kiln_error *error);

#endif
