#include "coordinator/output/map/write/stages.h"

#include "coordinator/output/image.h"
#include "coordinator/output/map/bands/bands.h"
#include "coordinator/output/map/charts/chart_graphs.h"
#include "coordinator/output/map/charts/nearest.h"
#include "worker/base/memory.h"

/* Order of the stages. Denoising reads gathered values only, so it comes before values are copied. Fill and borders
 * need all gathered values. Seams need every surface texel, and which texel a margin texel copies. Mixed directions are
 * normalized again; copies are made last. */
const struct kiln_map_stage *const kiln_map_stages[] = {&kiln_map_stage_measure, &kiln_map_stage_mean_error,
                                                        &kiln_map_stage_walls,   &kiln_map_stage_denoise,
                                                        &kiln_map_stage_fill,    &kiln_map_stage_borders,
                                                        &kiln_map_stage_seams,   &kiln_map_stage_directions,
                                                        &kiln_map_stage_dilate,  NULL};

static bool is_wanted(const struct kiln_map_stage *stage, const struct kiln_output_params *params)
{
    return stage->wanted == NULL || stage->wanted(params);
}

/* Adds the fields that a stage reads, and converts `planes` to the planes of these fields. */
static int add_stage(const struct kiln_map_stage *stage, struct kiln_layers *layers, uint32_t *planes,
                     const struct kiln_field_set *fields, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t f = 0; status == KILN_OK && f < KILN_MAP_STAGE_FIELDS && stage->fields[f] != NULL; f++)
        status = kiln_layers_add_field(layers, fields, stage->fields[f], &planes[f], error);
    planes[KILN_MAP_IF_ANY] = KILN_MAP_PLANES_MAX;
    KILN_TRY(status);
    if (stage->if_any != NULL && kiln_field_set_find(fields, stage->if_any) < fields->count)
        KILN_TRY(kiln_layers_add_field(layers, fields, stage->if_any, &planes[KILN_MAP_IF_ANY], error));
    if ((stage->features & KILN_MAP_POSITION) != 0)
        KILN_TRY(kiln_layers_add_vector(layers, &layers->position, error));
    if ((stage->features & KILN_MAP_NORMAL) != 0)
        KILN_TRY(kiln_layers_add_vector(layers, &layers->normal, error));
end:
    return status;
}

int kiln_map_stages_layers(const struct kiln_map_stage *const *stages, const struct kiln_output_params *params,
                           struct kiln_layers *layers, const struct kiln_field_set *fields, struct kiln_error *error)
{
    int status = KILN_OK;
    for (size_t i = 0; status == KILN_OK && stages[i] != NULL; i++) {
        if (i == KILN_MAP_STAGES_MAX)
            return kiln_fail(error, KILN_BUG, "there are more than %d stages of lightmaps", (int)KILN_MAP_STAGES_MAX);
        if (is_wanted(stages[i], params))
            status = add_stage(stages[i], layers, layers->reads[i], fields, error);
    }
    return status;
}

/* Takes the chart graph, and replaces the triangle of each texel by its chart. */
static int make_charts(struct kiln_map_work *work, struct kiln_error *error)
{
    struct kiln_map *map = work->map;
    const uint32_t mesh = work->result->scene->objects[kiln_map_object(work->result->surface, work->object)].mesh;
    const int status = kiln_bands_agree(
        map, kiln_chart_graphs_take(work->graphs, mesh, map->width, map->height, &work->graph, error), error);
    if (status != KILN_OK)
        return status;
#pragma omp parallel for schedule(static) if (kiln_map_texels(map) > KILN_IMAGE_ALONE)
    for (size_t i = kiln_map_first(map); i < kiln_map_end(map); i++)
        if (map->chart[i] != KILN_NONE)
            map->chart[i] = work->graph->chart[map->chart[i]];
    return KILN_OK;
}

static int make_nearest(struct kiln_map_work *work, struct kiln_error *error)
{
    const struct kiln_map *map = work->map;
    const int status = kiln_bands_agree(
        map, kiln_map_allocate(map, &work->nearest, sizeof *work->nearest, "nearest texels", error), error);
    if (status != KILN_OK)
        return status;
    return kiln_map_nearest(map, map->state, KILN_TEXEL_FILLED, work->nearest, error);
}

static int run_stage(const struct kiln_map_stage *stage, struct kiln_map_work *work, struct kiln_error *error)
{
    int status = KILN_OK;
    if ((stage->features & KILN_MAP_CHARTS) != 0 && work->graph == NULL)
        status = make_charts(work, error);
    if (status == KILN_OK && (stage->features & KILN_MAP_NEAREST) != 0 && work->nearest == NULL)
        status = make_nearest(work, error);
    work->reads = work->layers != NULL ? work->layers->reads[work->next] : NULL;
    return status == KILN_OK ? stage->run(work, error) : status;
}

int kiln_map_stages_begin(const struct kiln_map_stage *const *stages, struct kiln_map_work *work,
                          struct kiln_error *error)
{
    int status = KILN_OK;
    for (; status == KILN_OK && stages[work->next] != NULL && !stages[work->next]->after_joining; work->next++)
        if (is_wanted(stages[work->next], work->params))
            status = run_stage(stages[work->next], work, error);
    return status;
}

int kiln_map_stages_run_long(const struct kiln_map_stage *const *stages, struct kiln_map_work *work,
                             struct kiln_error *error)
{
    int status = KILN_OK;
    for (; status == KILN_OK && stages[work->next] != NULL; work->next++) {
        const struct kiln_map_stage *stage = stages[work->next];
        if (!is_wanted(stage, work->params))
            continue;
        if (stage->is_long == NULL || !stage->is_long(work))
            break;
        status = run_stage(stage, work, error);
    }
    return status;
}

void kiln_map_stages_release(struct kiln_map_work *work)
{
    if (work->map != NULL)
        kiln_map_free(work->map, &work->nearest, sizeof *work->nearest);
    kiln_free(&work->ghosts.records);
    work->ghosts.count = work->ghosts.capacity = 0;
    kiln_chart_graphs_give_back(work->graphs, &work->graph);
    work->next = 0;
}

int kiln_map_stages_run(const struct kiln_map_stage *const *stages, struct kiln_map_work *work,
                        struct kiln_error *error)
{
    int status = KILN_OK;
    for (; status == KILN_OK && stages[work->next] != NULL; work->next++)
        if (is_wanted(stages[work->next], work->params))
            status = run_stage(stages[work->next], work, error);
    kiln_map_stages_release(work);
    return status;
}
