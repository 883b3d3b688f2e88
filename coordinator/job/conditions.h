/* Conditions under which options count. A row of the table of options (options.h) may name a condition without which
 * its value has no effect; if it does not hold but the user gave the option, kiln refuses it or notes that it does not
 * count. */
#ifndef KILN_COORDINATOR_JOB_CONDITIONS_H
#define KILN_COORDINATOR_JOB_CONDITIONS_H

#include <stdbool.h>
#include <stdio.h>

#include "coordinator/job/job.h"

struct kiln_condition {
    bool (*holds)(const struct kiln_job *job);
    const char *otherwise; /* end of a sentence: why the option does not count, and how to change that */
    /* for tests: options, separated by blanks, with which the condition holds and does not ("": none needed), or names
     * of benches; and the command */
    const char *with, *without, *command;
};

extern const struct kiln_condition kiln_when_device, kiln_when_sky, kiln_when_image, kiln_when_patches, kiln_when_links,
    kiln_when_unshot, kiln_when_directions, kiln_when_undersampled, kiln_when_divided, kiln_when_nodes,
    kiln_when_voxels, kiln_when_cells, kiln_when_bounces, kiln_when_lean, kiln_when_gloss, kiln_when_caustics,
    kiln_when_paths_land, kiln_when_merged, kiln_when_shared, kiln_when_radius, kiln_when_density, kiln_when_lightmaps,
    kiln_when_leaves, kiln_when_volume, kiln_when_range, kiln_when_map_basis, kiln_when_picture, kiln_when_rgbm,
    kiln_when_traced, kiln_when_merging_view, kiln_when_accumulated, kiln_when_frames, kiln_when_lens,
    kiln_when_shown_lightmaps, kiln_when_ranks_bench, kiln_when_repeats;

struct kiln_option;
/* Whether the option, which this command has, takes effect in the job. */
bool kiln_option_counts(const struct kiln_job *job, const struct kiln_option *option);

/* Prints a note for each option that was given, by job file or command line, but has no effect; not for an option given
 * the value that switches it off (false, none, 1). Not collective. */
void kiln_job_print_idle(const struct kiln_job *job, FILE *stream);

#endif
