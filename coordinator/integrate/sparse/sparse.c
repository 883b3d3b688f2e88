#include "coordinator/integrate/sparse/sparse.h"

#include "coordinator/integrate/sparse/blocks.h"
#include "coordinator/integrate/sparse/nodes.h"

void kiln_sparse_find(struct kiln_sparse *sparse, const struct kiln_integrate_settings *settings,
                      const struct kiln_step *step, const struct kiln_rank_data *data, size_t tile_run)
{
    const struct kiln_surface *surface = &data->surface;
    const struct kiln_tile_run *run = &surface->tile_runs[tile_run];
    const uint64_t own = kiln_own_of_global(surface, run->first).at;
    if (kiln_step_has(step, KILN_WITH(blocks)))
        kiln_blocks_draw(sparse, surface, run, data->block + own, settings->indirect_scale, settings->seed, step);
    else
        kiln_nodes_draw(sparse, surface, run, data->mixture + own);
}

static void select_points(const struct kiln_integrate_settings *settings, const struct kiln_step *step,
                          const struct kiln_rank_data *data, size_t tile_run, struct kiln_selection *selection)
{
    struct kiln_sparse sparse;
    kiln_sparse_find(&sparse, settings, step, data, tile_run);
    selection->computed &= sparse.selection.computed;
    selection->few |= sparse.selection.few;
}

static bool blocks_wanted(const struct kiln_integrate_params *params) { return params->settings->indirect_scale > 1; }
static bool nodes_wanted(const struct kiln_integrate_params *params) { return params->settings->final_scale > 1; }

static int find_blocks(const struct kiln_integrate_params *params, const struct kiln_rank_data *data,
                       struct kiln_error *error)
{
    return kiln_blocks_find(&data->surface, params->backend, params->threads, params->settings->indirect_scale,
                            data->block, NULL, error);
}

static int find_nodes(const struct kiln_integrate_params *params, const struct kiln_rank_data *data,
                      struct kiln_error *error)
{
    return kiln_anchors_find(&data->surface, params->backend, params->threads, params->settings->final_scale,
                             data->mixture, error);
}

const struct kiln_companion kiln_companion_blocks = {.name = "blocks",
                                                     .by_step = true,
                                                     .wanted = blocks_wanted,
                                                     .field = "block",
                                                     .find = find_blocks,
                                                     .select = select_points};

const struct kiln_companion kiln_companion_nodes = {.name = "nodes",
                                                    .by_step = true,
                                                    .wanted = nodes_wanted,
                                                    .field = "mixture",
                                                    .find = find_nodes,
                                                    .select = select_points};
