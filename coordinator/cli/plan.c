/* kiln plan SCENE|JOB --ranks N: predicts cells, balance, memory of a rank by purpose, time, disk space and scaling of
 * a bake without baking. */
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "coordinator/bake/prepare/materials.h"
#include "coordinator/plan/plan.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/cli/commands.h"
#include "coordinator/files/json.h"
#include "coordinator/files/temporary.h"
#include "coordinator/view/curve.h"
#include "coordinator/files/html.h"
#include "coordinator/files/publish.h"
#include "coordinator/run/host_memory.h"
#include "coordinator/run/output_folder.h"
#include "worker/base/memory.h"

static double mebibytes(uint64_t bytes) { return (double)bytes / 1048576.0; }

static double node_memory(const struct kiln_job *job)
{
    if (job->plan.node_memory > 0.0)
        return job->plan.node_memory;
    return (double)kiln_host_memory() / 0x1p30;
}

static const char *backend_name(enum kiln_reckon_backend backend)
{
    return backend == KILN_RECKON_EMBREE ? "embree" : "vulkan";
}

/* ---- JSON ---- */

static json_t *memory_json(const struct kiln_plan_memory *m)
{
    return json_pack("{s:s, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I}", "units", "bytes",
                     "program", (json_int_t)m->program, "textures", (json_int_t)m->textures, "scene",
                     (json_int_t)m->scene, "geometry", (json_int_t)m->geometry, "bvh", (json_int_t)m->bvh,
                     "surface_all", (json_int_t)m->surface_all, "surface_own", (json_int_t)m->surface_own, "transport",
                     (json_int_t)m->light, "volume", (json_int_t)m->volume, "results", (json_int_t)m->results, "moving",
                     (json_int_t)m->moving, "landing", (json_int_t)m->in_step, "total", (json_int_t)m->total, "device",
                     (json_int_t)m->device);
}

/* The phases on both backends, which of them the seconds above are of, and the rounds in them. */
static json_t *backends_json(const struct kiln_plan *p)
{
    const struct kiln_foretold *rounds = &p->question.work.rounds;
    json_t *json = json_pack("{s:s, s:o, s:o}", "assumed", backend_name(p->backend), backend_name(KILN_RECKON_EMBREE),
                             kiln_reckon_json(&p->reckoned[KILN_RECKON_EMBREE]), backend_name(KILN_RECKON_VULKAN),
                             kiln_reckon_json(&p->reckoned[KILN_RECKON_VULKAN]));
    if (rounds->rounds > 0)
        (void)json_object_set_new(json, "rounds",
                                  json_pack("{s:i, s:i, s:f, s:f, s:b}", "tried_tiles", (int)rounds->tried, "rounds",
                                            (int)rounds->rounds, "samples_over_first_round", rounds->samples, "error",
                                            rounds->error, "limited", (int)rounds->limited));
    return json;
}

static json_t *seconds_json(const struct kiln_plan *p)
{
    const struct kiln_plan_seconds *s = &p->seconds;
    const struct kiln_roles *roles = &p->steps.roles;
    json_t *seconds = json_pack("{s:f, s:f, s:f, s:f, s:f}", "import", s->import, "world", s->world, "surface",
                                s->surface, "validity", s->validity, "emission", s->emission);
    if (p->visible.views > 0)
        (void)json_object_set_new(seconds, "views", json_real(s->views));
    for (uint32_t r = 0; r < roles->count; r++)
        (void)json_object_set_new(seconds, roles->of[r]->total, json_real(s->light[r]));
    json_t *after = json_pack("{s:f, s:f, s:f, s:f, s:f, s:f, s:i, s:f}", "probes", s->probes, "exchange", s->exchange,
                              "move", s->move, "checkpoints", s->save, "write", s->write, "total", s->total,
                              "assumed_bounces", (int)p->bounces, "calibration", p->calibration_seconds);
    (void)json_object_update(seconds, after);
    json_decref(after);
    (void)json_object_set_new(seconds, "backends", backends_json(p));
    return seconds;
}

/* Bytes of the two checkpoints that a node's folder holds, of its ranks alone; 0: there is no such folder. */
static uint64_t node_checkpoint_bytes(const struct kiln_plan *p, const struct kiln_job *job)
{
    return job->checkpoints.local != NULL && p->here.nodes > 0 ? 2 * p->checkpoint_bytes / (uint64_t)p->here.nodes : 0;
}

static json_t *disk_json(const struct kiln_plan *p, const struct kiln_job *job)
{
    return json_pack("{s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I, s:I}", "lightmaps", (json_int_t)p->lightmap_bytes,
                     "kiln_h5", (json_int_t)p->h5_bytes, "volume", (json_int_t)p->volume_bytes, "scene",
                     (json_int_t)p->scene_bytes, "preview", (json_int_t)p->preview_bytes, "export",
                     (json_int_t)p->export_bytes, "total", (json_int_t)p->disk_bytes, "checkpoint",
                     (json_int_t)p->checkpoint_bytes, "transport", (json_int_t)p->transport_bytes, "node_checkpoints",
                     (json_int_t)node_checkpoint_bytes(p, job));
}

/* One value for each role. */
static json_t *roles_json(const struct kiln_roles *roles, const double values[KILN_ROLES_MAX])
{
    json_t *all = json_object();
    for (uint32_t r = 0; r < roles->count; r++)
        (void)json_object_set_new(all, roles->of[r]->kind, json_real(values[r]));
    return all;
}

/* The imbalance of the ranks' work. */
static json_t *balance_json(const struct kiln_roles *roles, const struct kiln_simulated_light *light)
{
    return json_pack("{s:f, s:f, s:f, s:i, s:f, s:f, s:o, s:o, s:o}", "imbalance", light->imbalance, "trial_seconds",
                     light->trial, "imbalance_kept", light->kept, "repartitions", (int)light->repartitions,
                     "move_seconds", light->move, "points_most", light->points_most, "seconds",
                     roles_json(roles, light->seconds), "first_pass", roles_json(roles, light->first), "last_pass",
                     roles_json(roles, light->last));
}

static json_t *curve_json(const struct kiln_roles *roles, const struct kiln_scaled *curve, size_t count)
{
    json_t *array = json_array();
    for (size_t i = 0; i < count; i++) {
        const struct kiln_scaled *c = &curve[i];
        (void)json_array_append_new(
            array, json_pack("{s:i, s:i, s:f, s:f, s:f, s:o, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f}", "ranks",
                             (int)c->ranks, "nodes", (int)c->nodes, "points", c->points, "trace", c->trace, "imbalance",
                             c->light.imbalance, "balance", balance_json(roles, &c->light), "exchange", c->exchange,
                             "checkpoints", c->save, "find", c->find, "once", c->once, "write", c->write, "write_alone",
                             c->alone, "seconds", c->seconds, "efficiency", c->efficiency, "trace_efficiency",
                             c->trace_efficiency));
    }
    return array;
}

static json_t *rank_set_json(const struct kiln_rank_set *r, uint32_t rank)
{
    return json_pack("{s:I, s:I, s:I, s:I, s:I, s:I}", "rank", (json_int_t)rank, "own_points",
                     (json_int_t)r->own_points, "triangles", (json_int_t)r->triangles, "points", (json_int_t)r->points,
                     "radiance_probes", (json_int_t)r->probes, "bytes", (json_int_t)r->bytes);
}

static json_t *working_set_json(const struct kiln_working_set *w)
{
    json_t *ranks = json_array();
    for (uint32_t r = 0; r < w->rank_count; r++)
        (void)json_array_append_new(ranks, rank_set_json(&w->ranks[r], r));
    return json_pack(
        "{s:I, s:f, s:I, s:f, s:I, s:f, s:I, s:f, s:I, s:I, s:I, s:o}", "triangles_most", (json_int_t)w->most.triangles,
        "triangles_mean", w->triangles_mean, "points_most", (json_int_t)w->most.points, "points_mean", w->points_mean,
        "radiance_probes_most", (json_int_t)w->most.probes, "radiance_probes_mean", w->probes_mean, "bytes_most",
        (json_int_t)w->most.bytes, "bytes_mean", w->bytes_mean, "bytes_all", (json_int_t)w->bytes_all,
        "radiance_probes", (json_int_t)w->probes, "radiance_probe_bytes", (json_int_t)w->probe_bytes, "ranks", ranks);
}

static json_t *plan_json(const struct kiln_plan *p, const struct kiln_job *job)
{
    const struct kiln_surface_report *s = &p->surface;
    json_t *all =
        json_pack("{s:s, s:i, s:I, s:I, s:I, s:I, s:I, s:I, s:f, s:f, s:I, s:f, s:f, s:f}", "status", "done", "ranks",
                  (int)job->plan.ranks, "triangles", (json_int_t)p->triangles, "points", (json_int_t)s->points,
                  "points_min", (json_int_t)s->points_min, "points_max", (json_int_t)s->points_max, "cells_occupied",
                  (json_int_t)s->cells_occupied, "cells_total", (json_int_t)s->cells_total, "cell_size", s->cell_size,
                  "imbalance", s->imbalance, "probes", (json_int_t)p->probes, "bytes_per_point", p->bytes_per_point,
                  "bytes_per_triangle", p->bytes_per_triangle, "exchange_bytes_per_bounce", p->exchange_bytes);
    json_t *more =
        json_pack("{s:o, s:o, s:o, s:o, s:o, s:o}", "memory_per_rank", memory_json(&p->memory), "balance",
                  balance_json(&p->steps.roles, &p->here.light), "seconds", seconds_json(p), "disk_bytes",
                  disk_json(p, job), "strong_scaling", curve_json(&p->steps.roles, p->strong, p->curve_count),
                  "weak_scaling", curve_json(&p->steps.roles, p->weak, p->curve_count));
    if (all != NULL && more != NULL)
        (void)json_object_update(all, more);
    json_decref(more);
    if (all != NULL && p->working_set.probes > 0)
        (void)json_object_set_new(all, "working_set", working_set_json(&p->working_set));
    if (all != NULL)
        kiln_companions_tell_measured(kiln_companions, p->companions, all);
    if (all != NULL && p->visible.views > 0)
        (void)json_object_set_new(all, "visible_from",
                                  json_pack("{s:I, s:I, s:I, s:I}", "views", (json_int_t)p->visible.views, "valid",
                                            (json_int_t)p->visible.points, "seen", (json_int_t)p->visible.points_seen,
                                            "reached", (json_int_t)p->visible.points_reached));
    return all;
}

/* ---- text ---- */

static void print_cells(const struct kiln_plan *p, const struct kiln_job *job)
{
    (void)printf("%llu triangles, %llu surface points, %llu probes\n", (unsigned long long)p->triangles,
                 (unsigned long long)p->surface.points, (unsigned long long)p->probes);
    if (p->visible.views > 0)
        (void)printf("of %llu that light can reach, %llu are seen from %llu views, and %llu more light these\n",
                     (unsigned long long)p->visible.points, (unsigned long long)p->visible.points_seen,
                     (unsigned long long)p->visible.views, (unsigned long long)p->visible.points_reached);
    (void)printf("%llu cells of %g m, %llu of them occupied\n", (unsigned long long)p->surface.cells_total,
                 p->surface.cell_size, (unsigned long long)p->surface.cells_occupied);
    (void)printf("%u rank%s: %.1f cells and %llu to %llu points each, imbalance %.1f %% by points\n\n", job->plan.ranks,
                 job->plan.ranks == 1 ? "" : "s", (double)p->surface.cells_occupied / job->plan.ranks,
                 (unsigned long long)p->surface.points_min, (unsigned long long)p->surface.points_max,
                 100.0 * p->surface.imbalance);
}

static void print_memory(const struct kiln_plan *p, const struct kiln_job *job)
{
    const struct kiln_plan_memory *m = &p->memory;
    const struct {
        const char *name;
        uint64_t bytes;
    } rows[] = {{"program", m->program},
                {"scene file, mapped", m->scene},
                {"its images", m->textures},
                {"geometry", m->geometry},
                {"BVH (estimated)", m->bvh},
                {"tiles of all points", m->surface_all},
                {"own surface points", m->surface_own},
                {"light of own points", m->light},
                {"probes", m->volume},
                {"writing results", m->results},
                {"repartitioning, before these", m->moving},
                {"light paths, before these", m->in_step},
                {"a rank in total", m->total},
                {"of its GPU", m->device}};
    (void)printf("memory of the fullest rank, MiB\n");
    for (size_t i = 0; i < sizeof rows / sizeof *rows - (m->device == 0); i++)
        (void)printf("  %-22s %10.1f\n", rows[i].name, mebibytes(rows[i].bytes));
    (void)printf("%.1f bytes a surface point, %.1f bytes a triangle (BVH and images aside)\n", p->bytes_per_point,
                 p->bytes_per_triangle);
    const double fits = node_memory(job) * 0x1p30 / (double)m->total;
    (void)printf("a node with %.1f GiB holds %s%.0f such ranks\n\n", node_memory(job), fits < 1.0 ? "only " : "",
                 fits < 1.0 ? 0.0 : floor(fits));
}

enum { RANKS_TOLD = 16 };

static void print_set(const char *name, double own, double triangles, double points, double probes, double bytes)
{
    (void)printf("%9s%12.0f%12.0f%12.0f%12.0f%12.1f\n", name, own, triangles, points, probes, bytes / 0x1p20);
}

static void print_rank_set(const char *name, const struct kiln_rank_set *r)
{
    print_set(name, (double)r->own_points, (double)r->triangles, (double)r->points, (double)r->probes,
              (double)r->bytes);
}

static void print_working_set(const struct kiln_plan *p, const struct kiln_job *job)
{
    const struct kiln_working_set *w = &p->working_set;
    if (w->probes == 0)
        return;
    (void)printf(
        "what rays of a rank's points may reach, which end at %g m, and the radiance probes that they may ask\n"
        "%9s%12s%12s%12s%12s%12s\n",
        job->light.radiance.range, "rank", "own points", "triangles", "points", "probes", "MiB");
    for (uint32_t r = 0; r < w->rank_count && w->rank_count <= RANKS_TOLD; r++) {
        char name[16];
        (void)snprintf(name, sizeof name, "%u", r);
        print_rank_set(name, &w->ranks[r]);
    }
    print_rank_set("most", &w->most);
    print_set("mean", (double)p->surface.points / w->rank_count, w->triangles_mean, w->points_mean, w->probes_mean,
              w->bytes_mean);
    print_set("no range", (double)p->surface.points, (double)p->triangles, (double)p->surface.points, 0.0,
              (double)w->bytes_all);
    (void)printf("a rank keeps all %llu probes, %.1f MiB; points that see none have rays without an end\n\n",
                 (unsigned long long)w->probes, mebibytes(w->probe_bytes));
}

static void print_balance(const struct kiln_simulated_light *light)
{
    (void)printf("  moves      %10.2f s  points are repartitioned %u time%s by their cost\n", light->move,
                 light->repartitions, light->repartitions == 1 ? "" : "s");
    (void)printf("  imbalance of light %.1f %%; %.1f %% without repartitioning and work stealing\n",
                 100.0 * light->imbalance, 100.0 * light->kept);
}

/* The first role of a role's phase. */
static uint32_t first_of_phase(const struct kiln_roles *roles, uint32_t role)
{
    uint32_t first = 0;
    while (strcmp(roles->of[first]->phase, roles->of[role]->phase) != 0)
        first++;
    return first;
}

/* Seconds of all roles that have the phase of role `first`. */
static double phase_seconds(const struct kiln_plan *p, uint32_t first)
{
    double sum = 0.0;
    for (uint32_t r = 0; r < p->steps.roles.count; r++)
        sum += first_of_phase(&p->steps.roles, r) == first ? p->seconds.light[r] : 0.0;
    return sum;
}

static void print_light(const struct kiln_plan *p)
{
    const struct kiln_roles *roles = &p->steps.roles;
    double sum = p->seconds.probes;
    for (uint32_t r = 0; r < roles->count; r++)
        sum += p->seconds.light[r];
    (void)printf("  light      %10.2f s ", sum);
    for (uint32_t r = 0; r < roles->count; r++) /* roles of one phase are printed as one, at the place of the first */
        if (r == first_of_phase(roles, r) && (!roles->of[r]->optional || phase_seconds(p, r) > 0.0))
            (void)printf(" %s %.2f,", roles->of[r]->phase, phase_seconds(p, r));
    (void)printf(" probes %.2f\n", p->seconds.probes);
}

/* The whole bake, phase by phase, and on the other backend. */
static void print_phases(const struct kiln_plan *p)
{
    const struct kiln_reckoned *here = &p->reckoned[p->backend], *other = &p->reckoned[1 - p->backend];
    (void)printf("  by phase, %s:", backend_name(p->backend));
    for (int i = 0; i < KILN_RECKON_PHASES; i++)
        if (here->seconds[i] > 0.0)
            (void)printf(" %s %.2f,", kiln_reckon_phase_name((enum kiln_reckon_phase)i), here->seconds[i]);
    (void)printf(" together %.2f s\n", here->total);
    (void)printf("  with --backend %s%s %.2f s are expected, by times measured on other machines\n\n",
                 backend_name(1 - p->backend), p->backend == KILN_RECKON_EMBREE ? ", a GPU for each rank," : "",
                 other->total);
}

static void print_rounds(const struct kiln_plan *p)
{
    const struct kiln_foretold *rounds = &p->question.work.rounds;
    if (rounds->rounds == 0)
        return;
    (void)printf(
        "                          %u round%s, with the samples of the first times %.1f, to an error of %.2g %%, "
        "%s%s\n",
        rounds->rounds, rounds->rounds > 1 ? "s" : "", rounds->samples, 100.0 * rounds->error,
        rounds->tried > 0 ? "by a trial" : "as is typical",
        rounds->limited ? "; texels then have the most samples that one gets" : "");
}

static void print_time(const struct kiln_plan *p, const struct kiln_job *job)
{
    const struct kiln_plan_seconds *s = &p->seconds;
    (void)printf("time of the slowest rank, if its cores do nothing else, from samples traced here in %.1f s (%u "
                 "bounces assumed)\n",
                 p->calibration_seconds, p->bounces);
    (void)printf("  before     %10.2f s  import %.2f, BVH %.2f, surface points %.2f, validity %.2f, emission %.2f\n",
                 s->import + s->world + s->surface + s->validity + s->views + s->emission, s->import, s->world,
                 s->surface, s->validity, s->emission);
    if (p->visible.views > 0)
        (void)printf("                          and what the views see %.2f\n", s->views);
    print_light(p);
    print_rounds(p);
    (void)printf("  exchange   %10.2f s  a rank receives %.1f MiB in each bounce\n", s->exchange,
                 p->exchange_bytes / 1048576.0);
    for (size_t i = 0; i < KILN_COMPANIONS; i++)
        if (p->companions[i].text[0] != '\0')
            (void)printf("                          %s\n", p->companions[i].text);
    if (p->here.ranks > 1)
        print_balance(&p->here.light);
    if (s->save > 0.0)
        (void)printf("  saving     %10.2f s  %.0f checkpoint%s\n", s->save, p->here.saves,
                     p->here.saves > 1.0 ? "s" : "");
    (void)printf("  results    %10.2f s\n  in all     %10.2f s\n", s->write, s->total);
    print_phases(p);
    (void)printf("disk: %.1f MiB: lightmaps %.1f, kiln.h5 %.1f, volume.hdf %.1f, scene %.1f, scene.glb %.1f; while it "
                 "runs two checkpoints of %.1f MiB\n",
                 mebibytes(p->disk_bytes), mebibytes(p->lightmap_bytes), mebibytes(p->h5_bytes),
                 mebibytes(p->volume_bytes), mebibytes(p->scene_bytes), mebibytes(p->export_bytes),
                 mebibytes(p->checkpoint_bytes));
    if (p->transport_bytes > 0)
        (void)printf("      of it %.1f MiB of transport that is kept, %.2f s to write at 1 GB/s\n",
                     mebibytes(p->transport_bytes), (double)p->transport_bytes * 1e-9);
    if (job->checkpoints.local != NULL)
        (void)printf(
            "      and of each node up to %.1f MiB in '%s', from which the bake goes on while they are copied\n",
            mebibytes(node_checkpoint_bytes(p, job)), job->checkpoints.local);
}

/* The cause that costs the last point of a curve most, as text. */
static const char *limit_of(const struct kiln_scaled *first, const struct kiln_scaled *last, double work,
                            double *seconds)
{
    const double share = work / last->ranks, idle = last->trace - share * first->trace;
    const struct {
        const char *name;
        double lost;
    } losses[] = {{"work that every rank repeats or waits for (import, BVH)", last->once - share * first->once},
                  {"sending the positions of all points to every rank", last->find - share * first->find},
                  {"uneven work of the ranks, and repartitioning", idle + last->light.move},
                  {"the exchange of radiosity", last->exchange - share * first->exchange},
                  {"checkpoints", last->save - share * first->save},
                  {"writing the results", last->write - share * first->write}};
    size_t most = 0;
    for (size_t i = 1; i < sizeof losses / sizeof *losses; i++)
        if (losses[i].lost > losses[most].lost)
            most = i;
    *seconds = losses[most].lost;
    return losses[most].name;
}

static void print_curve(const char *name, const struct kiln_scaled *curve, size_t count, bool weak)
{
    (void)printf("\n%s scaling, simulated\n%9s%8s%12s%12s%9s%9s%9s%11s%9s%9s%9s%9s%9s%11s%12s%12s\n", name, "ranks",
                 "nodes", "points", "light s", "uneven", "kept", "moves s", "exchange s", "saving s", "find s",
                 "once s", "write s", "alone s", "in all s", "efficiency", "light only");
    for (size_t i = 0; i < count; i++) {
        const struct kiln_scaled *c = &curve[i];
        (void)printf("%9u%8u%12.3g%12.3g%7.1f %%%7.1f %%%9.3g%11.3g%9.3g%9.3g%9.3g%9.3g%9.3g%11.4g%10.1f %%%10.1f %%\n",
                     c->ranks, c->nodes, c->points, c->trace, 100.0 * c->light.imbalance, 100.0 * c->light.kept,
                     c->light.move, c->exchange, c->save, c->find, c->once, c->write, c->alone, c->seconds,
                     100.0 * c->efficiency, 100.0 * c->trace_efficiency);
    }
    double lost;
    const struct kiln_scaled *last = &curve[count - 1];
    const char *limit = limit_of(&curve[0], last, weak ? last->ranks : 1.0, &lost);
    if (count > 1)
        (void)printf("%u ranks: %.1f %% efficient; most is lost to %s: %.3g s of %.3g s\n", last->ranks,
                     100.0 * last->efficiency, limit, lost, last->seconds);
}

/* ---- files ---- */

static void add_rows(struct kiln_html *page, const char *kind, const struct kiln_scaled *curve, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const struct kiln_scaled *c = &curve[i];
        kiln_html_add(page, "%s,%u,%u,%.0f,%.6g,%.6g,%.6g,%u,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g,%.6g\n", kind,
                      c->ranks, c->nodes, c->points, c->trace, c->light.imbalance, c->light.kept, c->light.repartitions,
                      c->light.move, c->exchange, c->save, c->find, c->once, c->write, c->alone, c->seconds,
                      c->efficiency, c->trace_efficiency);
    }
}

static int write_csv(const char *directory, const struct kiln_plan *p, struct kiln_error *error)
{
    char path[KILN_PATH_SIZE];
    struct kiln_html page = {.error = error};
    kiln_html_add(&page, "kind,ranks,nodes,points,trace_s,imbalance,imbalance_kept,repartitions,move_s,exchange_s,"
                         "checkpoints_s,find_s,once_"
                         "s,write_s,write_alone_s,seconds,efficiency,trace_efficiency\n");
    add_rows(&page, "strong", p->strong, p->curve_count);
    add_rows(&page, "weak", p->weak, p->curve_count);
    const int status = kiln_path_join(path, directory, "scaling.csv", error);
    if (status == KILN_OK)
        return kiln_html_publish(&page, path);
    kiln_html_free(&page);
    return status;
}

static int write_plot(const char *directory, const struct kiln_plan *p, struct kiln_error *error)
{
    double values[KILN_CURVES][KILN_CURVE_MAX], ranks[KILN_CURVE_MAX];
    char title[120];
    for (size_t i = 0; i < p->curve_count; i++) {
        ranks[i] = p->strong[i].ranks;
        values[0][i] = p->strong[i].efficiency;
        values[1][i] = p->strong[i].trace_efficiency;
        values[2][i] = p->weak[i].efficiency;
        values[3][i] = p->weak[i].trace_efficiency;
    }
    (void)snprintf(title, sizeof title, "Simulated efficiency, %.3g points (weak: on one rank)", p->strong[0].points);
    return kiln_curve_write(directory, title, ranks,
                            (const double *const[]){values[0], values[1], values[2], values[3]}, p->curve_count, error);
}

static int write_files(const char *directory, const struct kiln_plan *p, struct kiln_error *error)
{
    const struct kiln_output_folder_params params = {.directory = directory, .kind = KILN_FOLDER_SHARED};
    struct kiln_output_folder *folder = NULL;
    int status;
    KILN_TRY(kiln_output_folder_begin(&folder, &params, error));
    KILN_TRY(write_csv(directory, p, error));
    KILN_TRY(write_plot(directory, p, error));
end:
    kiln_output_folder_end(&folder, false);
    return status;
}

static void print_plan(const struct kiln_plan *p, const struct kiln_job *job)
{
    print_cells(p, job);
    print_memory(p, job);
    print_working_set(p, job);
    print_time(p, job);
    if (job->plan.ranks > 1 || job->plan.points > 0) {
        print_curve("strong", p->strong, p->curve_count, false);
        print_curve("weak", p->weak, p->curve_count, true);
        (void)printf(
            "\nuneven: time for light of the slowest rank / mean - 1; kept: the same without repartitioning and "
            "work stealing\n");
    }
}

static int plan_here(struct kiln_job *job, const char *scene_file, struct kiln_error *error)
{
    struct kiln_prepared *prepared = NULL;
    struct kiln_phases phases = {0};
    struct kiln_plan *plan = NULL;
    int status;
    KILN_TRY(kiln_allocate(&plan, 1, sizeof *plan, "the plan", error));
    KILN_TRY(kiln_prepare(&prepared, MPI_COMM_SELF, job, scene_file, &phases, NULL, NULL, error));
    kiln_materials_settle(job, prepared->scene);
    KILN_TRY(kiln_plan_make(plan, prepared, job, &phases, error));
    if (job->json)
        KILN_TRY(kiln_json_print(plan_json(plan, job), error));
    else
        print_plan(plan, job);
    if (job->output != NULL)
        KILN_TRY(write_files(job->output, plan, error));
end:
    kiln_prepared_destroy(&prepared);
    if (plan != NULL)
        kiln_plan_release(plan);
    kiln_free(&plan);
    return status;
}

int kiln_command_plan(struct kiln_job *job, struct kiln_error *error)
{
    int rank, status = KILN_OK;
    (void)MPI_Comm_rank(MPI_COMM_WORLD, &rank);
    if (rank == 0) { /* rank 0 plans for all */
        struct kiln_temporary temporary = {.descriptor = -1};
        struct stat there;
        if (job->output != NULL && stat(job->output, &there) == 0 && !S_ISDIR(there.st_mode))
            status = kiln_fail(error, KILN_CANNOT_CREATE, "--output %.500s is not a folder: choose another name",
                               job->output);
        if (status == KILN_OK)
            status = kiln_temporary_make(&temporary, error);
        if (status == KILN_OK)
            status = plan_here(job, temporary.scene_file, error);
        kiln_temporary_remove(&temporary);
    }
    return kiln_agree(MPI_COMM_WORLD, status, error);
}
