/* The table of all stages (stage.h), and running them on a map. */
#ifndef KILN_COORDINATOR_OUTPUT_MAP_WRITE_STAGES_H
#define KILN_COORDINATOR_OUTPUT_MAP_WRITE_STAGES_H

#include "coordinator/output/map/stage.h"

/* All stages in their order, ended by NULL. */
extern const struct kiln_map_stage *const kiln_map_stages[];

/* Adds to `layers` the planes that the wanted stages read. KILN_BUG if a stage reads a field that the bake does not
 * have, or if they are too many. */
int kiln_map_stages_layers(const struct kiln_map_stage *const *stages, const struct kiln_output_params *params,
                           struct kiln_layers *layers, const struct kiln_field_set *fields, struct kiln_error *error);
/* Runs the wanted stages up to the first with `after_joining`; kiln_map_stages_run runs the others. Stops at the first
 * stage that fails. Graphs and arrays that stages have made are kept until kiln_map_stages_release; after it the work
 * can begin again with another map. */
int kiln_map_stages_begin(const struct kiln_map_stage *const *stages, struct kiln_map_work *work,
                          struct kiln_error *error);
/* Runs the next stages, up to the first that does not take long (is_long). */
int kiln_map_stages_run_long(const struct kiln_map_stage *const *stages, struct kiln_map_work *work,
                             struct kiln_error *error);
void kiln_map_stages_release(struct kiln_map_work *work);
/* Runs all wanted stages that have not run yet, and releases the data that they have made. Stops at the first stage
 * that fails. */
int kiln_map_stages_run(const struct kiln_map_stage *const *stages, struct kiln_map_work *work,
                        struct kiln_error *error);

#endif
