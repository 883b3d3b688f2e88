/* Private to kiln bench converge. */
#ifndef KILN_COORDINATOR_BENCH_CONVERGE_PRIVATE_H
#define KILN_COORDINATOR_BENCH_CONVERGE_PRIVATE_H

#include "coordinator/bench/child.h"
#include "coordinator/output/image.h"

enum { KILN_CONVERGE_METHODS = 16, KILN_CONVERGE_TRIALS = 15, KILN_CONVERGE_LAST = 4, KILN_CONVERGE_REFUSAL = 400 };

/* dB: pictures that differ less look alike. */
#define KILN_CONVERGE_LEVEL 45.0

/* A view, and how far it is from the reference. */
struct kiln_converge_trial {
    uint32_t samples; /* paths a pixel */
    double seconds;   /* of computing, by the clock */
    uint64_t rays;
    double rmse, nrmse, rel_rmse, picture_psnr, picture_dissimilarity; /* coordinator/view/compare.h */
};

/* A method, and its views in the order of their samples. */
struct kiln_converge_method {
    const char *name;                    /* as for kiln view --method; static */
    char refusal[KILN_CONVERGE_REFUSAL]; /* why it drew nothing; "": it did */
    int refusal_code;                    /* the status of that */
    struct kiln_converge_trial trials[KILN_CONVERGE_TRIALS];
    size_t count;
    /* what kiln_converge_judge finds; NaN: there is none */
    double psnr_at_equal_time; /* dB; none: its first view took longer */
    double gain;               /* dB for each doubling of the time, over the last KILN_CONVERGE_LAST views */
    double seconds_to_level;   /* none: not reached */
    bool at_most;              /* the first view has reached it already */
};

struct kiln_converge {
    struct kiln_job *job;
    char program[KILN_PATH_SIZE], said[KILN_PATH_SIZE], answer[KILN_PATH_SIZE];
    char reference[KILN_PATH_SIZE];                             /* the reference's file */
    char halves[2][KILN_PATH_SIZE];                             /* of the reference that is made */
    struct kiln_converge_method methods[KILN_CONVERGE_METHODS]; /* those that are asked for */
    size_t count;
    struct kiln_image *reference_image;
    uint32_t reference_samples; /* paths a pixel; 0: a given file */
    double reference_psnr;      /* of the reference's own error; NaN: not known */
    double equal_seconds;       /* the longest time that all methods have reached */
};

/* converge_judge.c. Holds the methods against each other. */
void kiln_converge_judge(struct kiln_converge *c);

/* converge_tell.c. Writes converge.csv and converge.svg, and prints the result. */
int kiln_converge_tell(const struct kiln_converge *c, struct kiln_error *error);

#endif
