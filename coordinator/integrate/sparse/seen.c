#include "coordinator/integrate/companion.h"

/* Companion that skips tile runs that no view sees (bake/light/visible_from.h). */

static bool seen_wanted(const struct kiln_integrate_params *params) { return params->seen != NULL; }

static int find(const struct kiln_integrate_params *params, const struct kiln_rank_data *data, struct kiln_error *error)
{
    (void)error;
    for (size_t f = 0; data->seen != NULL && f < data->surface.tile_run_count; f++)
        data->seen[f] = params->seen[f] != 0;
    return KILN_OK;
}

static void select_points(const struct kiln_integrate_settings *settings, const struct kiln_step *step,
                          const struct kiln_rank_data *data, size_t tile_run, struct kiln_selection *selection)
{
    (void)settings;
    (void)step;
    if (data->seen[tile_run] == 0)
        selection->computed = 0;
}

const struct kiln_companion kiln_companion_seen = {
    .name = "seen", .by_step = true, .wanted = seen_wanted, .field = "seen", .find = find, .select = select_points};
