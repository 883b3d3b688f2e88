#include "coordinator/bake/report/run_report.h"

#include "coordinator/bake/report/loading_report.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "coordinator/run/process_memory.h"
#include "coordinator/bake/prepare/materials.h"
#include "coordinator/bake/points/near_lights.h"
#include "coordinator/bake/report/reached.h"
#include "coordinator/bake/reckon/reckon.h"
#include "coordinator/bake/report/run_table.h"
#include "coordinator/import/import.h"
#include "coordinator/integrate/companion.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/files/json.h"
#include "coordinator/files/checksummed_json.h"
#include "worker/base/color.h"
#include "worker/base/memory.h"
#include "worker/base/text.h"

static const double DOUBLED = 1e-3; /* least fraction of the surface that is doubled for a warning */

/* Numbers that rank 0 gathers from each rank. */
enum {
    RANK_POINTS,
    RANK_INVALID,
    RANK_RSS,
    RANK_RAYS, /* of steps of each role */
    RANK_PROBES = RANK_RAYS + KILN_ROLES_MAX,
    RANK_PROBE_PATHS,
    RANK_PROBE_PATHS_ON_HOST,
    RANK_PSS,
    RANK_SHARED,
    RANK_RECEIVED,
    RANK_STOLEN_FROM,
    RANK_STOLEN_BY,
    RANK_RECOVERIES,
    RANK_FELL_BACK,
    RANK_VERIFIED,
    RANK_BEYOND,
    RANK_WORST /* bits of a non-negative double, which order like the double itself */,
    RANK_PROBES_IN, /* probes in state KILN_PROBE_IN_PLACE; the other states follow */
    RANK_VALUES = RANK_PROBES_IN + KILN_PROBE_STATES
};

static json_t *rgb_json(const double rgb[3]) { return json_pack("[f,f,f]", rgb[0], rgb[1], rgb[2]); }

/* Adds the settings of the quantities besides light that the bake computes. */
static void add_quantities(json_t *settings, const struct kiln_job *job)
{
    const double distance = job->light.occlusion.distance;
    if (distance > 0.0)
        json_object_set_new(settings, "ambient_occlusion",
                            isfinite(distance) ? json_real(distance) : json_string("inf"));
    if (job->light.directional != KILN_DIRECTIONAL_NONE)
        json_object_set_new(settings, "directional",
                            json_string(job->light.directional == KILN_DIRECTIONAL_SH1 ? "sh1" : "dominant"));
}

/* Settings that affect the result. */
static json_t *settings_json(const struct kiln_job *job)
{
    json_t *settings = json_pack(
        "{s:s, s:I, s:b, s:s, s:i, s:i, s:i, s:i, s:I, s:s}", "method",
        job->light.method != NULL ? job->light.method : "cells", "bounces", (json_int_t)job->light.bounces, "tail",
        job->light.tail || (job->light.bounces < 0 && !kiln_job_is_reference(job) && !kiln_job_is_radiosity(job)),
        "schedule", job->light.schedule == KILN_SCHEDULE_LEAN ? "lean" : "equal", "samples_direct",
        (int)job->light.samples_direct, "samples_bounce", (int)job->light.samples_bounce, "samples_indirect",
        (int)job->light.samples_indirect, "samples_probe", (int)job->volume.samples, "seed",
        (json_int_t)job->light.seed, "exchange",
        job->ranks.exchange == KILN_EXCHANGE_FULL      ? "full"
        : job->ranks.exchange == KILN_EXCHANGE_COMPACT ? "compact"
                                                       : "auto");
    if (job->light.indirect_scale > 0)
        json_object_set_new(settings, "indirect_scale", json_integer((json_int_t)1 << job->light.indirect_scale));
    if (job->light.final_scale > 0)
        json_object_set_new(settings, "final_scale", json_integer((json_int_t)1 << job->light.final_scale));
    if (job->light.guide > 0)
        json_object_set_new(settings, "guide", json_string("auto"));
    if (kiln_job_takes_gloss(job))
        json_object_set_new(settings, "materials",
                            json_string(job->light.materials == KILN_GLOSS_MODE_AUTO ? "auto" : "full"));
    add_quantities(settings, job);
    kiln_companions_report(kiln_companions, KILN_REPORT_SETTINGS, &(struct kiln_companion_told){.job = job}, NULL,
                           settings);
    return settings;
}

static json_t *scene_json(const struct kiln_prepared *p)
{
    const struct kiln_scene *s = p->scene;
    json_t *sources = json_array();
    for (size_t i = 0; i < s->source_count; i++)
        if (s->sources[i].size != KILN_SOURCE_MISSING)
            json_array_append_new(
                sources, json_pack("{s:s, s:I, s:o}", "path", kiln_scene_string(s, s->sources[i].path), "bytes",
                                   (json_int_t)s->sources[i].size, "xxh3_128", kiln_hash_json(s->sources[i].hash)));
    return json_pack("{s:o, s:o, s:I, s:I, s:I, s:I, s:f}", "content_xxh3_128", kiln_hash_json(s->header->content_hash),
                     "sources", sources, "objects", (json_int_t)s->object_count, "triangles",
                     (json_int_t)p->geometry->triangle_count, "emissive_triangles",
                     (json_int_t)p->lights->triangle_count, "punctual_lights", (json_int_t)s->light_count,
                     "texels_per_metre", p->surface->bricks == NULL ? (double)s->header->texels_per_metre : 0.0);
}

/* Describes the store: lightmaps or an octree with its leaves. */
static json_t *store_json(const struct kiln_prepared *p)
{
    const struct kiln_surface *s = p->surface;
    if (s->bricks == NULL)
        return json_pack("{s:s}", "kind", "lightmap");
    return json_pack("{s:s, s:f, s:[f, f, f], s:I, s:I, s:I}", "kind", "octree", "leaf_size", p->leaf_size, "origin",
                     p->geometry->leaf_origin.x + p->scene->header->centre[0],
                     p->geometry->leaf_origin.y + p->scene->header->centre[1],
                     p->geometry->leaf_origin.z + p->scene->header->centre[2], "leaves", (json_int_t)s->point_count,
                     "bricks", (json_int_t)s->tile_count, "slots", (json_int_t)s->slot_count);
}

/* Warns of lights that are closer to surfaces than a texel is wide. */
static void warn_of_near_lights(const struct kiln_prepared *p, json_t *warnings)
{
    char name[128], others[64] = "";
    const struct kiln_near_light near = kiln_near_lights(p->lights);
    if (near.objects == 0)
        return;
    kiln_text_plain(name, sizeof name, kiln_scene_string(p->scene, p->scene->objects[near.object].name));
    if (near.objects > 1)
        (void)snprintf(others, sizeof others, ", and %zu more objects have such lights", near.objects - 1);
    (void)json_array_append_new(
        warnings, json_sprintf("object '%s' has a point or spot light %.3g m away, nearer than its texels are wide "
                               "(%.3g m)%s: what such a light brings to those texels may be far off; move it away, or "
                               "make the lightmap finer",
                               name, near.distance, near.side, others));
}

/* Warns of surfaces that exist twice at one place: both are lit, and a ray may hit either. */
static void warn_of_doubled_faces(const struct kiln_prepared *p, json_t *warnings)
{
    const struct kiln_geometry *g = p->geometry;
    char name[2][96];
    if (!(g->doubled_area > DOUBLED * p->surface_report.geometry_area))
        return;
    for (size_t i = 0; i < 2; i++)
        kiln_text_plain(name[i], sizeof name[i], kiln_scene_string(p->scene, p->scene->objects[g->doubled[i]].name));
    (void)json_array_append_new(
        warnings,
        json_sprintf("at least %.3g m2 of surface are there twice, in one place and facing the same way, in objects "
                     "'%s' and '%s' for one: each is lit as if it were alone, but only one of the two "
                     "reflects light, whichever a ray happens to meet; remove one, or move them apart",
                     g->doubled_area, name[0], name[1]));
}

static void warn_of_enclosed_lights(const struct kiln_prepared *p, json_t *warnings)
{
    char text[512], name[128];
    for (size_t i = 0; i < p->enclosed_count; i++) {
        kiln_enclosed_light_text(&p->enclosed[i], p->scene, text, sizeof text);
        kiln_text_plain(name, sizeof name, kiln_enclosed_light_name(&p->enclosed[i], p->scene));
        (void)json_array_append_new(warnings, json_sprintf("light '%s': %s", name, text));
    }
}

json_t *kiln_scene_warnings(const struct kiln_prepared *p)
{
    const struct kiln_scene *s = p->scene;
    json_t *warnings = json_array();
    for (size_t i = 0; i < s->note_count; i++)
        if (s->notes[i].severity >= KILN_NOTE_REPEATED)
            (void)json_array_append_new(warnings, kiln_json_string(kiln_scene_string(s, s->notes[i].text)));
    if (kiln_lights_are_none(p->lights))
        (void)json_array_append_new(warnings, json_string(KILN_NO_LIGHT));
    warn_of_enclosed_lights(p, warnings);
    warn_of_near_lights(p, warnings);
    warn_of_doubled_faces(p, warnings);
    return warnings;
}

char *kiln_provenance(const struct kiln_job *job, const struct kiln_prepared *prepared)
{
    json_t *scene = scene_json(prepared);
    json_t *all =
        json_pack("{s:s, s:s, s:s, s:o, s:o}", "kiln", KILN_VERSION, "backend", kiln_backend_name(prepared->backend),
                  "instruction_set", prepared->instruction_set, "settings", settings_json(job), "scene", scene);
    char *text = json_dumps(all, JSON_COMPACT | JSON_SORT_KEYS);
    json_decref(all);
    return text;
}

static uint64_t count_invalid(const struct kiln_surface *surface)
{
    uint64_t invalid = 0;
    for (uint64_t i = 0; i < surface->count; i++)
        invalid += !kiln_point_valid(surface, (struct kiln_own_point){i});
    return invalid;
}

static void own_values(const struct kiln_run *run, uint64_t values[RANK_VALUES])
{
    const struct kiln_integrate_report *t = &run->solution->report;
    values[RANK_POINTS] = run->prepared->surface->count;
    values[RANK_INVALID] = count_invalid(run->prepared->surface);
    values[RANK_RSS] = kiln_process_memory(KILN_MEMORY_PEAK);
    values[RANK_PROBES] = run->probe_rays;
    values[RANK_PROBE_PATHS] = run->volume->paths;
    values[RANK_PROBE_PATHS_ON_HOST] = run->volume->paths_on_host;
    values[RANK_PSS] = kiln_process_memory(KILN_MEMORY_SHARE);
    values[RANK_SHARED] = kiln_node_rank(run->prepared->node) == 0 ? kiln_node_bytes(run->prepared->node) : 0;
    values[RANK_RECEIVED] = t->received;
    struct kiln_backend_info info;
    kiln_backend_info(run->prepared->backend, &info);
    values[RANK_RECOVERIES] = info.recoveries;
    values[RANK_FELL_BACK] = info.fell_back;
    values[RANK_VERIFIED] = info.verified;
    values[RANK_BEYOND] = info.beyond;
    memcpy(&values[RANK_WORST], &info.worst, sizeof info.worst);
    for (uint64_t i = 0; i < run->volume->count; i++)
        values[RANK_PROBES_IN + run->volume->places[i].state]++;
    for (size_t i = 0; i < t->steps.count; i++) {
        values[RANK_RAYS + t->steps.of[i].step.role] += t->steps.of[i].rays;
        values[RANK_STOLEN_FROM] += t->steps.of[i].given;
        values[RANK_STOLEN_BY] += t->steps.of[i].taken;
    }
}

/* The decision about repartitioning after a step; null: there was none to take. */
static json_t *rebalance_json(const struct kiln_step_balance *b)
{
    if (!b->judged)
        return json_null();
    const char *why = b->moved        ? "moved"
                      : b->cost > 0.0 ? "moving the points would take longer than it saves"
                                      : "hardly anything to gain";
    return json_pack("{s:b, s:s, s:f, s:f, s:f, s:I}", "moved", b->moved, "why", why, "imbalance", b->imbalance,
                     "predicted_gain", b->gain, "predicted_cost", b->cost, "points", (json_int_t)b->points);
}

/* Buffers for the gathered numbers. */
struct gathered {
    uint64_t *values; /* rank 0: RANK_VALUES for each rank */
    double *phases;   /* rank 0: KILN_PHASES_MAX for each rank */
    uint64_t *stolen; /* per step, over all ranks: points that were computed by a rank other than their owner */
    uint64_t *rays;   /* per step: rays of this rank; on rank 0, of each rank */
    /* of the companions, on rank 0 of all ranks */
    uint64_t counts[KILN_COMPANIONS * KILN_COMPANION_COUNTS];
    int ranks;
};

/* Adds what the companions tell. */
static void add_companions(json_t *json, const struct kiln_run *run, enum kiln_report_place place,
                           const struct gathered *g, const struct kiln_step_report *step)
{
    const struct kiln_companion_told told = {
        .job = run->job, .scene = run->prepared->scene, .solution = run->solution, .step = step};
    kiln_companions_report(kiln_companions, place, &told, g != NULL ? g->counts : NULL, json);
}

/* Lists the rays of each rank in step i, for its own points and for those of others. */
static json_t *step_rays_json(const struct kiln_integrate_report *t, const struct gathered *g, size_t i)
{
    json_t *array = json_array();
    for (size_t r = 0; r < (size_t)g->ranks; r++)
        json_array_append_new(array, json_integer((json_int_t)g->rays[r * t->steps.count + i]));
    return array;
}

/* Lists the steps of light, or (`quantities`) those of the other quantities. */
static json_t *steps_json(const struct kiln_run *run, const struct gathered *g, bool quantities)
{
    const struct kiln_integrate_report *t = &run->solution->report;
    json_t *array = json_array();
    for (size_t i = 0; i < t->steps.count; i++) {
        const struct kiln_step_report *p = &t->steps.of[i];
        if ((p->step.quantity != NULL) != quantities)
            continue;
        json_t *step = json_pack("{s:s, s:i, s:i, s:i, s:f, s:f, s:f, s:f, s:o, s:o, s:I, s:o, s:o}", "kind",
                                 t->roles.of[p->step.role]->kind, "part", (int)p->step.part, "bounce",
                                 (int)p->step.bounce, "samples", (int)p->step.samples, "seconds", p->seconds,
                                 "exchange_seconds", p->exchange_seconds, "device_seconds", p->device_seconds, "energy",
                                 kiln_luminance(p->energy.incident), "incident", rgb_json(p->energy.incident),
                                 "reflected", rgb_json(p->energy.reflected), "stolen_points", (json_int_t)g->stolen[i],
                                 "rays_per_rank", step_rays_json(t, g, i), "rebalance", rebalance_json(&p->balance));
        add_companions(step, run, KILN_REPORT_STEP, g, p);
        json_array_append_new(array, step);
    }
    return array;
}

/* Light that has met no diffuse surface before, as traced from the lights and as found by points. */
static void add_first_light(json_t *json, const char *layer, const struct kiln_first_light *light)
{
    if (light->compared)
        (void)json_object_set_new(json, layer,
                                  json_pack("{s:o, s:o, s:f, s:f}", "traced", rgb_json(light->traced), "found",
                                            rgb_json(light->found), "difference", light->difference, "error",
                                            light->error));
}

static json_t *first_light_json(const struct kiln_energy *e)
{
    json_t *json = json_object();
    add_first_light(json, "direct", &e->straight);
    add_first_light(json, "caustic", &e->caustic);
    return json;
}

/* Adds the light of lamps with textures: its integral and the estimate of its samples. Nothing, if there are none. */
static void add_textured(json_t *json, const struct kiln_energy *e)
{
    if (e->textured[0] + e->textured[1] + e->textured[2] > 0.0)
        (void)json_object_set_new(json, "lamps_with_textures",
                                  json_pack("{s:o, s:o, s:f}", "integral", rgb_json(e->textured), "sampled",
                                            rgb_json(e->drawn), "error", e->drawn_error));
}

static json_t *energy_json(const struct kiln_energy *e, const struct kiln_units *units)
{
    json_t *json =
        json_pack("{s:s, s:o, s:o, s:o, s:o, s:o, s:o, s:f, s:o, s:o, s:o, s:f, s:f, s:f, s:o}", "units", units->flux,
                  "emitted", rgb_json(e->emitted), "glass", rgb_json(e->glass), "gloss", rgb_json(e->gloss), "absorbed",
                  rgb_json(e->absorbed), "escaped", rgb_json(e->escaped), "blocked", rgb_json(e->blocked),
                  "lost_on_backs", e->lost, "ranged", rgb_json(e->ranged), "unfound", rgb_json(e->unfound), "left_over",
                  rgb_json(e->left_over), "residual", e->residual, "error", e->error, "relative_residual", e->relative,
                  "first_light", first_light_json(e));
    add_textured(json, e);
    return json;
}

/* Least light that a point's error is divided by, as a fraction of the mean over all points. */
#define LEAST_LIGHT 0.1

/* Luminance of all light of a point. */
static double light_of(const struct kiln_solution *solution, uint64_t i)
{
    double e[3];
    for (uint64_t c = 0; c < 3; c++)
        e[c] = (double)solution->direct[3 * i + c] + (double)solution->indirect[3 * i + c] +
               (solution->own->caustic != NULL ? (double)solution->own->caustic[3 * i + c] : 0.0);
    return kiln_luminance(e);
}

/* Number of points in tile runs whose error, relative to the light, has a root mean square above the target. */
static uint64_t points_above(const struct kiln_run *run, const uint16_t *error, double mean)
{
    const struct kiln_surface *s = run->prepared->surface;
    uint64_t above = 0;
    for (size_t f = 0; error != NULL && f < s->tile_run_count; f++) {
        const struct kiln_tile_run *tile_run = &s->tile_runs[f];
        const uint64_t first = kiln_own_of_global(s, tile_run->first).at;
        double square = 0.0;
        uint32_t valid = 0;
        for (uint64_t i = first; i < first + tile_run->count; i++)
            if (kiln_point_valid(s, (struct kiln_own_point){i})) {
                const double light = fmax(light_of(run->solution, i), LEAST_LIGHT * mean),
                             relative = light > 0.0 ? (double)kiln_error_unpack(error[i]) / light : 0.0;
                square += relative * relative;
                valid++;
            }
        if (square > (double)valid * run->job->light.target_error * run->job->light.target_error)
            above += valid;
    }
    return above;
}

/* Collective. Adds the outcome of --target-error for a bake with --patches links: the target, and the fractions of
 * points above it. One fraction goes by the error of all light. Two go by the errors of direct light and of indirect
 * light (links) alone, where these are known. */
static void add_target_of_links(const struct kiln_run *run, double mean, double points, json_t *json)
{
    static const char *const keys[] = {"above_target", "above_target_direct", "above_target_indirect"};
    const struct kiln_rank_data *own = run->solution->own;
    const uint16_t *const errors[] = {run->solution->error, own->error_direct, own->error_indirect};
    uint64_t above[3];
    for (int i = 0; i < 3; i++)
        above[i] = points_above(run, errors[i], mean);
    (void)MPI_Allreduce(MPI_IN_PLACE, above, 3, MPI_UINT64_T, MPI_SUM, run->prepared->communicator);
    (void)json_object_set_new(json, "target", json_real(run->job->light.target_error));
    for (int i = 0; i < 3; i++)
        if (errors[i] != NULL)
            (void)json_object_set_new(json, keys[i], json_real(points > 0.0 ? (double)above[i] / points : 0.0));
}

/* Collective. Means over all points of the irradiance and of its standard error, luminance. */
static json_t *error_json(const struct kiln_run *run)
{
    const struct kiln_surface *s = run->prepared->surface;
    double sums[3] = {0}; /* squared error, irradiance, number of points */
    for (uint64_t i = 0; i < s->count; i++) {
        if (!kiln_point_valid(s, (struct kiln_own_point){i}))
            continue;
        const double error = (double)kiln_error_unpack(run->solution->error[i]);
        sums[0] += error * error;
        sums[1] += light_of(run->solution, i);
        sums[2] += 1.0;
    }
    (void)MPI_Allreduce(MPI_IN_PLACE, sums, 3, MPI_DOUBLE, MPI_SUM, run->prepared->communicator);
    const double mean = sums[2] > 0.0 ? sums[1] / sums[2] : 0.0, rms = sums[2] > 0.0 ? sqrt(sums[0] / sums[2]) : 0.0;
    json_t *json =
        json_pack("{s:f, s:f, s:f, s:s}", "mean_irradiance", mean, "rms_standard_error", rms, "mean_relative",
                  mean > 0.0 ? rms / mean : 0.0, "standard_errors_are_of", "raw samples, before denoising");
    if (run->job->light.target_error > 0.0 && kiln_job_has_links(run->job))
        add_target_of_links(run, mean, sums[2], json);
    add_companions(json, run, KILN_REPORT_ERROR, NULL, NULL);
    return json;
}

/* Lists the objects whose mean light would change by more than KILN_DENSITY_MOST at double texel density, those with
 * the largest change first. */
static json_t *moved_json(const struct kiln_run *run)
{
    const struct kiln_density_check *d = run->density;
    const struct kiln_scene *scene = run->prepared->scene;
    json_t *moved = json_array();
    double below = INFINITY;
    while (json_array_size(moved) < d->count) { /* in falling order; objects with the same change together */
        double next = 0.0;
        for (size_t i = 0; i < scene->object_count; i++)
            if (d->objects[i].moves < below)
                next = fmax(next, d->objects[i].moves);
        for (size_t i = 0; i < scene->object_count; i++)
            if (d->objects[i].moves == next)
                (void)json_array_append_new(moved,
                                            json_pack("{s:s, s:f, s:f, s:f}", "name",
                                                      kiln_scene_string(scene, scene->objects[i].original_name), "mean",
                                                      d->objects[i].mean, "mean_at_half_density", d->objects[i].coarse,
                                                      "moves_at_double_density", d->objects[i].moves));
        below = next;
    }
    return moved;
}

/* Reports whether the texel density was checked, and the result. */
static json_t *density_json(const struct kiln_run *run)
{
    const struct kiln_density_check *d = run->density;
    if (!d->done)
        return json_pack("{s:b, s:s}", "checked", 0, "because",
                         d->wanted                           ? d->because.message
                         : run->job->lightmaps.check_density ? "there is no light"
                                                             : "--check-density asks for it");
    return json_pack("{s:b, s:f, s:I, s:f, s:o}", "checked", 1, "seconds", d->seconds, "points", (json_int_t)d->points,
                     "threshold", KILN_DENSITY_MOST, "objects", moved_json(run));
}

/* Adds the lightmap of the object's back, if one is published. */
static void add_back(const struct kiln_run *run, size_t object, const char *name, json_t *json)
{
    const struct kiln_surface *s = run->prepared->surface;
    const size_t map = s->object_count + object;
    char path[512];
    if (s->bricks != NULL || map >= s->map_count || s->lightmaps[map].published == 0)
        return;
    (void)snprintf(path, sizeof path, "lightmaps/back/%s.exr", name);
    (void)json_object_set_new(json, "lightmap_back", json_string(path));
    (void)json_object_set_new(json, "valid_back", json_integer((json_int_t)run->lightmaps[map].valid));
    (void)json_object_set_new(json, "filled_back", json_integer((json_int_t)run->lightmaps[map].filled));
}

static json_t *objects_json(const struct kiln_run *run)
{
    const struct kiln_scene *scene = run->prepared->scene;
    json_t *array = json_array();
    for (size_t i = 0; i < scene->object_count; i++) {
        const char *name = kiln_scene_string(scene, scene->objects[i].name);
        const struct kiln_lightmap_report *r = &run->lightmaps[i];
        char path[512];
        const bool published = run->prepared->surface->lightmaps[i].published != 0,
                   octree = run->prepared->surface->bricks != NULL;
        (void)snprintf(path, sizeof path, "lightmaps/%s.exr", name);
        json_t *object = json_pack(
            "{s:s, s:s, s:s?, s:i, s:i, s:I, s:I, s:I, s:I, s:I, s:f, s:f, s:f, s:f, s:f, s:f, s:f}", "name",
            kiln_scene_string(scene, scene->objects[i].original_name), "file_name", name, "lightmap",
            published ? path : NULL, "width", octree ? 0 : (int)scene->objects[i].lightmap_width, "height",
            octree ? 0 : (int)scene->objects[i].lightmap_height, "valid", (json_int_t)r->valid, "filled",
            (json_int_t)r->filled, "dilated", (json_int_t)r->dilated, "contested", (json_int_t)r->contested, "foreign",
            (json_int_t)r->foreign, "border_texels", r->border, "border_disturbed", r->border_disturbed, "seam_before",
            r->seam_difference_before, "seam_after", r->seam_difference_after, "texels_per_metre", r->texels_per_metre,
            "mean", r->mean, "relative_error", r->error);
        if (kiln_job_parts(run->job) > 1)
            json_object_set_new(object, "mean_error", json_real(r->mean_error));
        if (run->job->lightmaps.vertex_light)
            json_object_set_new(object, "vertex_error", json_real((double)run->vertices->error[i]));
        if (run->density->done) {
            json_object_set_new(object, "mean_at_half_density", json_real(run->density->objects[i].coarse));
            json_object_set_new(object, "half_density_error", json_real(run->density->objects[i].error));
        }
        if (scene->objects[i].source_node != KILN_NONE) { /* the source is glTF */
            json_object_set_new(object, "node", json_integer((json_int_t)scene->objects[i].source_node));
            json_object_set_new(object, "mesh", json_integer((json_int_t)scene->objects[i].source_mesh));
        }
        if (scene->objects[i].source_instance != KILN_NONE)
            json_object_set_new(object, "instance", json_integer((json_int_t)scene->objects[i].source_instance));
        add_back(run, i, name, object);
        json_array_append_new(array, object);
    }
    return array;
}

/* How much of the borders of charts reads light of other charts, over all lightmaps, and the density that would avoid
 * it (padding_factor in scene.h). */
static json_t *borders_json(const struct kiln_run *run)
{
    const struct kiln_scene *scene = run->prepared->scene;
    double length = 0.0, disturbed = 0.0;
    uint64_t contested = 0, foreign = 0, lightmaps = 0;
    for (size_t i = 0; i < scene->object_count; i++) {
        const struct kiln_lightmap_report *r = &run->lightmaps[i];
        length += r->border;
        disturbed += r->border_disturbed;
        contested += r->contested;
        foreign += r->foreign;
        lightmaps += r->border_disturbed > 0.0;
    }
    return json_pack("{s:f, s:f, s:I, s:I, s:I, s:f, s:f}", "texels", length, "disturbed_texels", disturbed,
                     "disturbed_lightmaps", (json_int_t)lightmaps, "contested", (json_int_t)contested, "foreign",
                     (json_int_t)foreign, "padding_factor", (double)scene->header->padding_factor, "texels_per_metre",
                     (double)scene->header->texels_per_metre);
}

/* Effect of denoising over all lightmaps. `seconds` sums up the time of each lightmap on its own threads. */
static json_t *denoise_json(const struct kiln_run *run)
{
    double before[2] = {0}, after[2] = {0}, seconds = 0.0;
    for (size_t i = 0; i < run->prepared->surface->map_count; i++) {
        const struct kiln_lightmap_report *r = &run->lightmaps[i];
        seconds += r->denoise_seconds;
        for (int l = 0; l < 2; l++) {
            before[l] += r->noise_before[l];
            after[l] += r->noise_after[l];
        }
    }
    return json_pack("{s:s, s:f, s:f, s:f}", "method", kiln_job_denoises(run->job) ? "regression" : "none", "seconds",
                     seconds, "variance_left_direct", before[0] > 0.0 ? after[0] / before[0] : 1.0,
                     "variance_left_indirect", before[1] > 0.0 ? after[1] / before[1] : 1.0);
}

static json_t *ranks_json(const struct kiln_run *run, const uint64_t *values, int value)
{
    json_t *per_rank = json_array();
    for (int r = 0; r < run->prepared->ranks; r++)
        json_array_append_new(per_rank, json_integer((json_int_t)values[(size_t)r * RANK_VALUES + (size_t)value]));
    return per_rank;
}

/* Report of the trial before the first step; null: there was none. */
static json_t *trial_json(const struct kiln_integrate_report *t)
{
    return t->trial_seconds > 0.0
               ? json_pack("{s:f, s:o}", "seconds", t->trial_seconds, "rebalance", rebalance_json(&t->trial))
               : json_null();
}

static json_t *balance_json(const struct kiln_run *run, const uint64_t *values)
{
    const struct kiln_surface_report *s = &run->prepared->surface_report;
    json_t *per_rank = ranks_json(run, values, RANK_POINTS);
    json_t *stolen =
        json_pack("{s:b, s:o, s:o}", "on", run->solution->report.steals_work, "from_rank",
                  ranks_json(run, values, RANK_STOLEN_FROM), "by_rank", ranks_json(run, values, RANK_STOLEN_BY));
    return json_pack("{s:s, s:f, s:I, s:I, s:f, s:o, s:o, s:o}", "partition",
                     run->job->ranks.partition_objects ? "objects" : "cells", "point_imbalance", s->imbalance,
                     "cells_occupied", (json_int_t)s->cells_occupied, "cells_total", (json_int_t)s->cells_total,
                     "cell_size", s->cell_size, "points_per_rank", per_rank, "stolen_points", stolen, "trial",
                     trial_json(&run->solution->report));
}

/* Memory of each node that Slurm gives this job, bytes; 0: not a Slurm job, or no memory was requested. */
static uint64_t asked_memory(void)
{
    const char *mebibytes = getenv("SLURM_MEM_PER_NODE");
    return mebibytes != NULL ? strtoull(mebibytes, NULL, 10) << 20 : 0;
}

static json_t *memory_json(const struct kiln_run *run, const uint64_t *values)
{
    uint64_t most = 0, shared = 0;
    json_t *per_rank = json_array(), *proportional = json_array();
    for (int r = 0; r < run->prepared->ranks; r++) {
        const uint64_t *rank = values + (size_t)r * RANK_VALUES;
        most = rank[RANK_RSS] > most ? rank[RANK_RSS] : most;
        shared = rank[RANK_SHARED] > shared ? rank[RANK_SHARED] : shared;
        json_array_append_new(per_rank, json_integer((json_int_t)rank[RANK_RSS]));
        json_array_append_new(proportional, json_integer((json_int_t)rank[RANK_PSS]));
    }
    return json_pack("{s:s, s:I, s:o, s:I, s:o, s:I}", "units", "bytes", "peak_rank", (json_int_t)most, "peak_per_rank",
                     per_rank, "shared_node", (json_int_t)shared, "proportional_per_rank", proportional, "asked_node",
                     (json_int_t)asked_memory());
}

/* Collective. The fraction of the run so far that ranks spent in exchanges and in waiting for each other; on rank 0,
 * else NULL. */
static json_t *mpi_json(const struct kiln_run *run)
{
    const struct kiln_prepared *p = run->prepared;
    const struct kiln_integrate_report *t = &run->solution->report;
    double spent = t->waiting_seconds;
    for (size_t i = 0; i < t->steps.count; i++)
        spent += t->steps.of[i].exchange_seconds;
    const double all = MPI_Wtime() - run->phases->begin, share = all > 0.0 ? fmin(1.0, spent / all) : 0.0;
    double low, high, sum;
    (void)MPI_Reduce(&share, &low, 1, MPI_DOUBLE, MPI_MIN, 0, p->communicator);
    (void)MPI_Reduce(&share, &high, 1, MPI_DOUBLE, MPI_MAX, 0, p->communicator);
    (void)MPI_Reduce(&share, &sum, 1, MPI_DOUBLE, MPI_SUM, 0, p->communicator);
    if (p->rank != 0)
        return NULL;
    return json_pack("{s:{s:f, s:f, s:f}}", "waiting_share", "min", low, "avg", sum / p->ranks, "max", high);
}

static json_int_t total(const uint64_t *values, int ranks, int what)
{
    uint64_t sum = 0;
    for (int r = 0; r < ranks; r++)
        sum += values[(size_t)r * RANK_VALUES + (size_t)what];
    return (json_int_t)sum;
}

/* Returns the number of points in solid matter. Points left out because no view needs them do not count. */
static json_t *invalid_json(const struct kiln_run *run, const uint64_t *values)
{
    if (run->job->light.only_visible_from == NULL)
        return json_integer(total(values, run->prepared->ranks, RANK_INVALID));
    return json_integer((json_int_t)(run->prepared->surface_report.points - run->visible->points));
}

/* Collective. Reports, on rank 0, the points of kiln.h5 that were packed while light was computed; else NULL. */
static json_t *ahead_json(const struct kiln_run *run)
{
    const MPI_Comm comm = run->prepared->communicator;
    struct kiln_points_ahead_report own;
    kiln_points_ahead_report(run->ahead, &own);
    uint64_t counts[3] = {own.chunks * KILN_H5_CHUNK_ROWS, own.bytes, own.direct * KILN_H5_CHUNK_ROWS};
    double processor = own.processor, seconds = own.end - own.begin;
    (void)MPI_Reduce(run->prepared->rank == 0 ? MPI_IN_PLACE : counts, counts, 3, MPI_UINT64_T, MPI_SUM, 0, comm);
    (void)MPI_Reduce(run->prepared->rank == 0 ? MPI_IN_PLACE : &processor, &processor, 1, MPI_DOUBLE, MPI_SUM, 0, comm);
    (void)MPI_Reduce(run->prepared->rank == 0 ? MPI_IN_PLACE : &seconds, &seconds, 1, MPI_DOUBLE, MPI_MAX, 0, comm);
    return run->prepared->rank != 0
               ? NULL
               : json_pack("{s:{s:I, s:I, s:I, s:f, s:f}}", "points", "packed", (json_int_t)counts[0], "direct_packed",
                           (json_int_t)counts[2], "bytes", (json_int_t)counts[1], "processor_seconds", processor,
                           "seconds", seconds);
}

static json_t *volume_json(const struct kiln_run *run, const uint64_t *values)
{
    const struct kiln_volume_result *v = run->volume;
    const int ranks = run->prepared->ranks;
    json_t *json =
        json_pack("{s:[I,I,I], s:[f,f,f], s:[f,f,f], s:{s:I, s:I, s:I, s:I}}", "size", (json_int_t)v->size[0],
                  (json_int_t)v->size[1], (json_int_t)v->size[2], "origin", v->origin[0], v->origin[1], v->origin[2],
                  "spacing", v->spacing[0], v->spacing[1], v->spacing[2], "probes", "in_place",
                  total(values, ranks, RANK_PROBES_IN + KILN_PROBE_IN_PLACE), "moved",
                  total(values, ranks, RANK_PROBES_IN + KILN_PROBE_MOVED), "filled",
                  total(values, ranks, RANK_PROBES_IN + KILN_PROBE_FILLED), "buried",
                  total(values, ranks, RANK_PROBES_IN + KILN_PROBE_BURIED));
    if (v->sources_left_out > 0) {
        const struct kiln_scene *scene = run->prepared->scene;
        const uint32_t name = scene->objects[v->largest_left_out].original_name;
        (void)json_object_set_new(json, "left_out",
                                  json_pack("{s:I, s:s}", "objects", (json_int_t)v->sources_left_out, "largest",
                                            kiln_scene_string(scene, name)));
    }
    if (total(values, ranks, RANK_PROBE_PATHS) > 0)
        (void)json_object_set_new(json, "light_paths",
                                  json_pack("{s:I, s:I}", "traced", total(values, ranks, RANK_PROBE_PATHS), "on_host",
                                            total(values, ranks, RANK_PROBE_PATHS_ON_HOST)));
    return json;
}

/* Lists the numbers of rays, by role of the steps and for probes; *sum receives their total. */
static json_t *rays_json(const struct kiln_roles *roles, const uint64_t *values, int ranks, double *sum)
{
    json_t *rays = json_object();
    *sum = 0.0;
    for (uint32_t r = 0; r <= roles->count; r++) {
        const bool probes = r == roles->count;
        const json_int_t own = total(values, ranks, probes ? RANK_PROBES : RANK_RAYS + (int)r);
        (void)json_object_set_new(rays, probes ? "probes" : roles->of[r]->total, json_integer(own));
        *sum += (double)own;
    }
    return rays;
}

/* Seconds that the slowest rank spent in a phase; NULL: none. */
static double phase_seconds(const json_t *phases, const char *name)
{
    double sum = 0.0;
    size_t index;
    const json_t *phase;
    json_array_foreach(phases, index, phase)
    {
        if (name != NULL && strcmp(json_string_value(json_object_get(phase, "name")), name) == 0)
            sum += json_real_value(json_object_get(json_object_get(phase, "seconds"), "max"));
    }
    return sum;
}

/* Seconds that the slowest rank spent in the phases that trace rays. */
static double tracing_seconds(const struct kiln_roles *roles, const json_t *phases)
{
    double sum = phase_seconds(phases, "probes");
    for (uint32_t r = 0; r < roles->count; r++)
        sum += phase_seconds(phases, roles->of[r]->phase);
    for (size_t i = 0; kiln_companions[i] != NULL; i++)
        sum += phase_seconds(phases, kiln_companions[i]->phase);
    return sum;
}

/* Lists features of the scene that cost kernels time. Kernels skip the work for a feature that the scene does not
 * have. */
static json_t *features_json(const struct kiln_prepared *p)
{
    static const char *const passages[] = {[KILN_PASSAGE_NONE] = "none",
                                           [KILN_PASSAGE_MASK] = "masks",
                                           [KILN_PASSAGE_BLEND] = "fractions",
                                           [KILN_PASSAGE_TINT] = "fractions that depend on colour",
                                           [KILN_PASSAGE_PANE] = "fractions that depend on colour and angle"};
    const struct kiln_lights *l = p->lights;
    const size_t textured = l->textured_count;
    size_t spots = 0;
    bool smooth = false;
    for (size_t i = 0; i < l->point_count; i++)
        spots += l->points[i].spot;
    for (size_t i = 0; i < p->scene->mesh_count; i++)
        smooth = smooth || (p->scene->meshes[i].flags & KILN_MESH_SMOOTH) != 0;
    return json_pack("{s:s, s:b, s:b, s:{s:I, s:I, s:I, s:I, s:I, s:s}}", "let_through", passages[p->geometry->passage],
                     "smooth_normals", smooth, "coincident_opposite_faces", (int)p->geometry->coincident, "lights",
                     "emissive_triangles", (json_int_t)(l->triangle_count - textured),
                     "emissive_triangles_with_texture", (json_int_t)textured, "points",
                     (json_int_t)(l->point_count - spots), "spots", (json_int_t)spots, "directional",
                     (json_int_t)l->directional_count, "environment",
                     !l->environment          ? "none"
                     : l->conditional != NULL ? "image"
                                              : "constant");
}

/* Explains the choice of the backend. `device`: it is a device, or was one when it was created. */
static json_t *choice_json(const struct kiln_backend_choice *choice, bool device)
{
    const char *why = !choice->asked       ? "asked for, or the checkpoint's"
                      : choice->processors ? "processors are predicted to be done sooner"
                      : device             ? "a GPU is predicted to be done sooner"
                                           : "there is no GPU that works";
    const struct kiln_reckoned *embree = &choice->reckoned[KILN_RECKON_EMBREE],
                               *vulkan = &choice->reckoned[KILN_RECKON_VULKAN];
    return json_pack("{s:s, s:f, s:f, s:o, s:o, s:f, s:f, s:I}", "why", why, "embree_seconds", embree->total,
                     "vulkan_seconds", vulkan->total, "embree", kiln_reckon_json(embree), "vulkan",
                     kiln_reckon_json(vulkan), "kernels_missing", choice->question.kernels, "rays",
                     kiln_backend_rays(choice), "threads", (json_int_t)choice->question.threads);
}

/* The kernels of the backend of rank 0 that ran. */
static json_t *kernels_json(const struct kiln_backend_info *info)
{
    json_t *list = json_array();
    for (size_t i = 0; i < info->kernel_count; i++)
        (void)json_array_append_new(list, json_string(info->kernels[i]));
    return list;
}

/* The backend of rank 0, with recoveries and verified texels of all ranks. */
static json_t *backend_json(const struct kiln_prepared *p, const uint64_t *values)
{
    struct kiln_backend_info info;
    double worst = 0.0;
    kiln_backend_info(p->backend, &info);
    for (int r = 0; r < p->ranks; r++) {
        double own;
        memcpy(&own, &values[(size_t)r * RANK_VALUES + RANK_WORST], sizeof own);
        worst = fmax(worst, own);
    }
    return json_pack(
        "{s:s, s:b, s:o, s:s, s:s, s:o, s:I, s:I, s:o, s:f, s:f, s:I, s:I, s:I, s:I, s:f}", "name", info.name,
        "compact_bvh", info.compact_tree, "choice", choice_json(&p->choice, info.on_device || info.fell_back), "device",
        info.device, "instruction_set", p->instruction_set, "kernels", kernels_json(&info), "kernels_kept",
        (json_int_t)info.kernels_found, "kernels_compiled", (json_int_t)info.kernels_made, "because", features_json(p),
        "build_seconds", info.build_seconds, "device_seconds", info.device_seconds, "recoveries",
        total(values, p->ranks, RANK_RECOVERIES), "ranks_fallen_back", total(values, p->ranks, RANK_FELL_BACK),
        "verified_texels", total(values, p->ranks, RANK_VERIFIED), "verified_beyond",
        total(values, p->ranks, RANK_BEYOND), "verified_worst", isfinite(worst) ? worst : 1e300);
}

static json_t *units_json(const struct kiln_run *run)
{
    const struct kiln_units *units = kiln_units_of(run->job->scene.units, run->prepared->scene);
    return json_pack("{s:s, s:s, s:s, s:s}", "kind", units->kind, "irradiance", units->irradiance, "radiance",
                     units->radiance, "because", kiln_units_reason(run->job->scene.units, run->prepared->scene));
}

/* The whitest of a mesh's materials. */
static uint32_t whitest_material(const struct kiln_scene *scene, const struct kiln_mesh *mesh)
{
    uint32_t whitest = 0;
    float most = -1.0f;
    for (uint64_t t = 0; t < mesh->triangle_count; t++) {
        const uint32_t m = scene->triangle_materials[mesh->triangle_first + t];
        const float *color = scene->materials[m].base_color, sum = color[0] + color[1] + color[2];
        if (sum > most) {
            most = sum;
            whitest = m;
        }
    }
    return whitest;
}

/* The object whose tile the tail fits worst, and its whitest material. */
static json_t *pocket_json(const struct kiln_run *run)
{
    const struct kiln_scene *scene = run->prepared->scene;
    const struct kiln_object *object = &scene->objects[run->solution->report.tail_pocket];
    const uint32_t material = whitest_material(scene, &scene->meshes[object->mesh]);
    return json_pack("{s:s, s:s}", "object", kiln_scene_string(scene, object->original_name), "material",
                     kiln_scene_string(scene, scene->materials[material].name));
}

/* Describes the scene and the findings about it. */
static json_t *found_scene_json(const struct kiln_run *run)
{
    const struct kiln_prepared *p = run->prepared;
    json_t *scene = scene_json(p);
    json_object_set_new(scene, "warnings", kiln_scene_warnings(p));
    json_object_set_new(scene, "lit", json_boolean(!kiln_lights_are_none(p->lights)));
    if (p->enclosed_count > 0)
        json_object_set_new(scene, "enclosed_lights", json_integer((json_int_t)p->enclosed_count));
    json_object_set_new(scene, "file", kiln_json_string(run->job->scene.file));
    char *path = realpath(run->job->scene.file, NULL); /* kiln export looks for the scene there */
    if (path != NULL)
        json_object_set_new(scene, "path", kiln_json_string(path));
    free(path);
    json_t *parts = kiln_parts_report(run->job, p->import.parts);
    if (parts != NULL)
        json_object_set_new(scene, "parts", parts);
    return scene;
}

/* The rounds as a trial told them, and the seconds of the whole bake as its first round did. */
static json_t *foretold_json(const struct kiln_prepared *p)
{
    const struct kiln_foretold *f = &p->foretold;
    json_t *json = json_pack("{s:i, s:i, s:f, s:f, s:b}", "tried_tiles", (int)f->tried, "rounds", (int)f->rounds,
                             "samples_over_first_round", f->samples, "error", f->error, "limited", (int)f->limited);
    if (p->expected_then > 0.0 && json != NULL)
        (void)json_object_set_new(json, "total_after_first_round", json_real(p->expected_then));
    return json;
}

/* Adds the job, the machine and the times. */
static void add_run(json_t *root, const struct kiln_run *run, json_t *phases, const uint64_t *values)
{
    const struct kiln_prepared *p = run->prepared;
    const struct kiln_integrate_report *t = &run->solution->report;
    double total_rays;
    json_t *rays = rays_json(&t->roles, values, p->ranks, &total_rays);
    const double traced = tracing_seconds(&t->roles, phases);
    json_object_set_new(root, "status", json_string("done"));
    json_object_set_new(root, "kiln", json_string(KILN_VERSION));
    json_object_set_new(root, "output", kiln_json_string(run->directory));
    json_object_set_new(root, "scene", found_scene_json(run));
    json_object_set_new(root, "job", settings_json(run->job));
    json_object_set_new(root, "materials", kiln_materials_json(run->job, run->materials, p->scene, run->solution));
    json_object_set_new(root, "units", units_json(run));
    json_object_set_new(root, "backend", backend_json(p, values));
    json_object_set_new(root, "ranks", json_integer(p->ranks));
    json_object_set_new(root, "threads", json_integer((json_int_t)p->threads));
    json_object_set_new(root, "seconds", json_real(MPI_Wtime() - run->phases->begin));
    json_object_set_new(root, "restarts", json_integer((json_int_t)t->restarts));
    json_object_set_new(root, "seconds_before", json_real(t->seconds_before));
    json_object_set_new(root, "phases", phases);
    json_object_set_new(root, "expected", kiln_reckon_json(&p->expected));
    if (p->foretold.tried > 0)
        json_object_set_new(root, "foretold", foretold_json(p));
    json_object_set_new(root, "rays", rays);
    json_object_set_new(root, "mrays_per_second", json_real(traced > 0.0 ? total_rays / traced * 1e-6 : 0.0));
}

/* The steps of light, and the tail. */
static void add_steps(json_t *root, const struct kiln_run *run, const struct gathered *g)
{
    const struct kiln_integrate_report *t = &run->solution->report;
    json_object_set_new(root, "bounces", steps_json(run, g, false));
    json_t *quantities = steps_json(run, g, true);
    if (json_array_size(quantities) > 0)
        json_object_set(root, "quantities", quantities);
    json_decref(quantities);
    json_object_set_new(root, "indirect_bounces", json_integer((json_int_t)t->bounces));
    json_object_set_new(root, "tail",
                        json_pack("{s:b, s:o, s:f, s:f, s:f, s:f, s:b}", "added", t->tail, "ratio",
                                  rgb_json(t->tail_ratio), "share", t->tail_share, "error", fmax(t->tail_error, 0.0),
                                  "object_error", t->tail_object_error, "tile_error", t->tail_tile_error, "diverges",
                                  t->tail_error == KILN_TAIL_DIVERGES));
    if (t->tail_tile_error > 0.0)
        json_object_set_new(json_object_get(root, "tail"), "pocket", pocket_json(run));
    if (t->landing.radius > 0.0 && kiln_job_is_reference(run->job))
        json_object_set_new(root, "merge_radius", json_real(t->landing.radius));
    add_companions(root, run, KILN_REPORT_LIGHT, g, NULL);
}

/* Energy, errors and surface points. */
static void add_points(json_t *root, const struct kiln_run *run, json_t *error_reached, const uint64_t *values)
{
    const struct kiln_prepared *p = run->prepared;
    json_t *energy = energy_json(&run->solution->report.energy, kiln_units_of(run->job->scene.units, p->scene));
    json_object_set_new(root, "energy", energy);
    json_object_set_new(root, "error", error_reached);
    json_object_set_new(
        root, "points",
        json_pack("{s:I, s:I, s:o, s:I, s:I, s:f, s:f, s:f, s:f}", "count", (json_int_t)p->surface_report.points,
                  "texels", (json_int_t)p->surface_report.texels, "invalid", invalid_json(run, values), "shared",
                  (json_int_t)p->surface_report.overlapped_texels, "divided", (json_int_t)p->surface->divided_count,
                  "area", p->surface_report.area, "geometry_area", p->surface_report.geometry_area, "doubled_area",
                  p->geometry->doubled_area, "worst_object_area_error", p->surface_report.worst_object_area_error));
    if (run->job->light.only_visible_from != NULL) {
        /* lamps light surfaces that have no points in this bake */
        json_object_set_new(energy, "residual", json_null());
        json_object_set_new(energy, "relative_residual", json_null());
        json_object_set_new(root, "visible_from",
                            json_pack("{s:s, s:I, s:I, s:I, s:I}", "given", run->job->light.only_visible_from, "views",
                                      (json_int_t)run->visible->views, "valid", (json_int_t)run->visible->points,
                                      "seen", (json_int_t)run->visible->points_seen, "reached",
                                      (json_int_t)run->visible->points_reached));
    }
}

/* Adds points, memory, work and messages of the ranks. */
static void add_ranks(json_t *root, const struct kiln_run *run, json_t *mpi, const struct gathered *g)
{
    const uint64_t *values = g->values;
    const struct kiln_prepared *p = run->prepared;
    json_object_set_new(root, "store", store_json(p));
    json_object_set_new(root, "balance", balance_json(run, values));
    json_object_set_new(root, "memory", memory_json(run, values));
    add_companions(root, run, KILN_REPORT_RANKS, g, NULL);
    json_object_set_new(mpi, "received_between_nodes", json_integer(total(values, p->ranks, RANK_RECEIVED)));
    add_companions(mpi, run, KILN_REPORT_MPI, g, NULL);
    json_object_set_new(root, "mpi", mpi);
}

/* Adds the output files and their measured properties. */
static void add_files(json_t *root, const struct kiln_run *run, const struct gathered *g)
{
    if (run->volume->size[0] != 0)
        json_object_set_new(root, "volume", volume_json(run, g->values));
    if (run->job->lightmaps.vertex_light)
        json_object_set_new(root, "vertices",
                            json_pack("{s:I}", "count", (json_int_t)run->vertices->first[run->vertices->object_count]));
    add_companions(root, run, KILN_REPORT_FILES, g, NULL);
    json_object_set_new(root, "objects", objects_json(run));
    json_object_set_new(root, "borders", borders_json(run));
    json_object_set_new(root, "denoise", denoise_json(run));
    json_object_set_new(root, "density", density_json(run));
}

static json_t *report_on_root(const struct kiln_run *run, json_t *phases, json_t *error_reached, json_t *mpi,
                              const struct gathered *g)
{
    json_t *root = json_object();
    add_run(root, run, phases, g->values);
    add_steps(root, run, g);
    add_points(root, run, error_reached, g->values);
    add_ranks(root, run, mpi, g);
    add_files(root, run, g);
    return root;
}

/* Collective. */
static int make_room(const struct kiln_run *run, struct gathered *g, struct kiln_error *error)
{
    const struct kiln_prepared *p = run->prepared;
    const size_t ranks = (size_t)p->ranks;
    int status;
    KILN_TRY(kiln_allocate(&g->stolen, run->solution->report.steps.count, sizeof *g->stolen, "the report", error));
    KILN_TRY(kiln_allocate(&g->rays, run->solution->report.steps.count * (p->rank == 0 ? ranks : 1), sizeof *g->rays,
                           "the report", error));
    if (p->rank == 0)
        KILN_TRY(kiln_allocate(&g->values, ranks * RANK_VALUES, sizeof *g->values, "the report", error));
    if (p->rank == 0)
        KILN_TRY(kiln_allocate(&g->phases, ranks * KILN_PHASES_MAX, sizeof *g->phases, "the report", error));
end:
    return kiln_agree(p->communicator, status, error);
}

/* Collective. */
static void gather(const struct kiln_run *run, struct gathered *g)
{
    const struct kiln_prepared *p = run->prepared;
    const struct kiln_integrate_report *t = &run->solution->report;
    uint64_t own[RANK_VALUES] = {0};
    own_values(run, own);
    (void)MPI_Gather(own, RANK_VALUES, MPI_UINT64_T, g->values, RANK_VALUES, MPI_UINT64_T, 0, p->communicator);
    kiln_companions_count(kiln_companions, run->solution, g->counts);
    (void)MPI_Reduce(p->rank == 0 ? MPI_IN_PLACE : g->counts, g->counts, (int)(sizeof g->counts / sizeof *g->counts),
                     MPI_UINT64_T, MPI_SUM, 0, p->communicator);
    for (size_t i = 0; i < t->steps.count; i++) {
        g->stolen[i] = t->steps.of[i].given;
        g->rays[i] = t->steps.of[i].rays;
    }
    (void)MPI_Gather(p->rank == 0 ? MPI_IN_PLACE : g->rays, (int)t->steps.count, MPI_UINT64_T, g->rays,
                     (int)t->steps.count, MPI_UINT64_T, 0, p->communicator);
    (void)MPI_Reduce(p->rank == 0 ? MPI_IN_PLACE : g->stolen, g->stolen, (int)t->steps.count, MPI_UINT64_T, MPI_SUM, 0,
                     p->communicator);
}

int kiln_run_report(json_t **report, const struct kiln_run *run, struct kiln_error *error)
{
    const struct kiln_prepared *p = run->prepared;
    struct gathered g = {.ranks = p->ranks};
    *report = NULL;
    const int status = make_room(run, &g, error);
    if (status == KILN_OK) {
        gather(run, &g);
        json_t *phases = kiln_phases_json(run->phases, p->communicator, g.phases);
        json_t *error_reached = error_json(run), *mpi = mpi_json(run), *ahead = ahead_json(run);
        json_t *loading = kiln_loading_report(p, run->phases);
        if (p->rank == 0) {
            *report = report_on_root(run, phases, error_reached, mpi, &g);
            json_object_set_new(*report, "beside_loading", loading);
            json_object_set_new(*report, "beside_passes", ahead);
            json_object_set_new(*report, "notes", kiln_run_notes(*report));
            json_t *improve = kiln_best_option(*report);
            if (improve != NULL)
                json_object_set_new(*report, "improve", improve);
        } else {
            json_decref(error_reached);
        }
    }
    kiln_free(&g.values);
    kiln_free(&g.phases);
    kiln_free(&g.stolen);
    kiln_free(&g.rays);
    return status;
}
