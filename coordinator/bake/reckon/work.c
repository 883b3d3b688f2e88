#include "coordinator/bake/reckon/work.h"

#include <math.h>

#include "coordinator/bake/reckon/preview_size.h"
#include "coordinator/bake/reckon/rounds_expected.h"
#include "coordinator/bake/reckon/steps.h"
#include "coordinator/bake/volume/volume.h"
#include "coordinator/integrate/companion.h"
#include "worker/scene/gloss.h"

/* Bounces where the light decides on them: plain scenes settle after 5 to 7, those with gloss or light from afar
 * after 12 to 25. Where all have equal samples, light is followed down to 1e-5: 15 to 20 bounces, or half as many pairs
 * by unshot power. */
enum { TYPICAL_BOUNCES = 7, TYPICAL_HARD = 18, TYPICAL_EQUAL = 18, TYPICAL_UNSHOT = 9 };
#define COARSE_BACKS                                                                                                   \
    0.25 /* points of a back over those of the front: texels are twice as wide (worker/scene/surface.h) */
#define OF_BORDERS 0.35 /* fraction of the texels that a layout does not cover, in which charts' borders lie */
/* Share of the surface with gloss from which caustics are taken to be worth their noise, and the power of all samples
 * of rounds by which theirs grow then. */
#define GLOSS_KEPT 0.1
#define CAUSTICS_POWER 0.3
enum { RAYS_SHARE = 4 }; /* a point has a fourth of a gather's rays to share with light paths (integrate/land/land.h) */

/* ---- surface ---- */

double kiln_work_points_of(const struct kiln_scene *scene, size_t object)
{
    const struct kiln_object *o = &scene->objects[object];
    return (double)o->lightmap_width * (double)o->lightmap_height * fmin(scene->meshes[o->mesh].uv_area, 1.0);
}

/* Fraction of a mesh's triangles whose backs have light of their own. */
static double backs_of(const struct kiln_scene *scene, const struct kiln_mesh *mesh)
{
    uint64_t count = 0;
    for (uint64_t t = mesh->triangle_first; t < mesh->triangle_first + mesh->triangle_count; t++)
        count += scene->materials[scene->triangle_materials[t]].double_sided != 0;
    return (double)count / fmax((double)mesh->triangle_count, 1.0);
}

static bool has_backs(const struct kiln_scene *scene)
{
    bool any = false;
    for (size_t i = 0; i < scene->material_count; i++)
        any = any || scene->materials[i].double_sided != 0;
    return any;
}

double kiln_work_points(const struct kiln_scene *scene, bool both_sides)
{
    const bool any = has_backs(scene);
    double points = 0.0, backs = 0.0;
    for (size_t i = 0; i < scene->object_count; i++) {
        const struct kiln_object *o = &scene->objects[i];
        const double texels = (double)o->lightmap_width * (double)o->lightmap_height,
                     covered = kiln_work_points_of(scene, i);
        const bool fine = both_sides || (o->flags & (KILN_OBJECT_FINE_BACKS | KILN_OBJECT_BOTH_SIDES)) != 0;
        if (any && (i == 0 || o->mesh != scene->objects[i - 1].mesh))
            backs = backs_of(scene, &scene->meshes[o->mesh]);
        points += (1.0 + backs * (fine ? 1.0 : COARSE_BACKS)) * (covered + OF_BORDERS * (texels - covered));
    }
    return points;
}

/* Facts about a mesh by its materials. */
struct mesh_facts {
    double glossy; /* fraction of its surface that is taken with its gloss */
    double lamps;  /* triangles that emit light */
};

static struct mesh_facts facts_of(const struct kiln_scene *scene, const struct kiln_mesh *mesh)
{
    struct mesh_facts facts = {0.0, 0.0};
    double all = 0.0;
    const struct kiln_vec3 *p = scene->positions + mesh->vertex_first;
    for (uint64_t t = mesh->triangle_first; t < mesh->triangle_first + mesh->triangle_count; t++) {
        const uint32_t *corner = scene->triangles + 3 * t, material = scene->triangle_materials[t];
        const struct kiln_vec3 a = p[corner[0]], b = p[corner[1]], c = p[corner[2]];
        const double area = (double)vec3_length(vec3_cross(vec3_sub(b, a), vec3_sub(c, a)));
        const float *emission = scene->materials[material].emission;
        all += area;
        facts.glossy += kiln_gloss_taken(scene, material) != NULL ? area : 0.0;
        facts.lamps += emission[0] > 0.0f || emission[1] > 0.0f || emission[2] > 0.0f ? 1.0 : 0.0;
    }
    facts.glossy /= all > 0.0 ? all : 1.0;
    return facts;
}

/* Whether the triangles' materials have anything to say, which takes a look at each. */
static bool has_facts(const struct kiln_scene *scene)
{
    bool any = scene->taken != NULL;
    for (size_t i = 0; i < scene->material_count; i++) {
        const float *emission = scene->materials[i].emission;
        any = any || emission[0] > 0.0f || emission[1] > 0.0f || emission[2] > 0.0f;
    }
    return any;
}

/* Gloss, as a share of the surface points, and lamps: two triangles each as a rule. */
static void count_materials(struct kiln_work *w, const struct kiln_scene *scene, double covered)
{
    struct mesh_facts facts = {0.0, 0.0};
    const bool any = has_facts(scene);
    double glossy = 0.0;
    for (size_t i = 0; i < scene->object_count && any; i++) {
        const uint32_t mesh = scene->objects[i].mesh;
        if (i == 0 || mesh != scene->objects[i - 1].mesh) /* instances of a mesh mostly follow one another */
            facts = facts_of(scene, &scene->meshes[mesh]);
        glossy += facts.glossy * kiln_work_points_of(scene, i);
        w->lamps += 0.5 * facts.lamps;
    }
    w->gloss = covered > 0.0 ? glossy / covered : 0.0;
    w->lamps += (double)scene->light_count;
}

/* ---- objects far off the detail, as the ground around a house ---- */

enum {
    SAMPLES = 4096,
    CORNERS = 96
};                /* triangles whose places are the detail; corners of an object that may lie far off */
#define WIDTH 8.0 /* half the detail's extent over the standard deviation of these places */

struct extent {
    double low[3], high[3];
};

static void place_of(const struct kiln_scene *scene, const struct kiln_object *o, uint64_t corner, double place[3])
{
    const struct kiln_mesh *mesh = &scene->meshes[o->mesh];
    const struct kiln_vec3 v =
        scene->positions[mesh->vertex_first + scene->triangles[3 * mesh->triangle_first + corner]];
    for (int a = 0; a < 3; a++) {
        const double *m = o->transform + 4 * a;
        place[a] = m[0] * (double)v.x + m[1] * (double)v.y + m[2] * (double)v.z + m[3];
    }
}

static bool is_plain(const struct kiln_scene *scene, const struct kiln_object *o)
{
    return 3 * scene->meshes[o->mesh].triangle_count <= CORNERS;
}

/* Extent of the triangles of objects that are not plain, by the mean and spread of some places of each in proportion.
 * An axis without spread has no extent: nothing is far along it. */
static struct extent detail_of(const struct kiln_scene *scene, double triangles)
{
    double sum[3] = {0.0}, square[3] = {0.0}, count = 0.0, place[3];
    const double every = fmax(1.0, triangles / SAMPLES);
    double next = 0.0, before = 0.0;
    for (size_t i = 0; i < scene->object_count; i++) {
        const double end = before + (double)scene->meshes[scene->objects[i].mesh].triangle_count;
        for (; next < end; next += every) {
            if (is_plain(scene, &scene->objects[i]))
                continue;
            place_of(scene, &scene->objects[i], 3 * (uint64_t)(next - before), place);
            for (int a = 0; a < 3; a++) {
                sum[a] += place[a];
                square[a] += place[a] * place[a];
            }
            count++;
        }
        before = end;
    }
    struct extent detail = {{0.0}, {0.0}};
    for (int a = 0; a < 3 && count > 0.0; a++) {
        const double mean = sum[a] / count, wide = WIDTH * sqrt(fmax(square[a] / count - mean * mean, 0.0));
        detail.low[a] = mean - wide;
        detail.high[a] = mean + wide;
    }
    return detail;
}

/* Fraction of a plain object that lies outside the detail, by its box; 0 for one with many triangles. */
static double far_part(const struct kiln_scene *scene, const struct kiln_object *o, const struct extent *detail)
{
    const uint64_t corners = 3 * scene->meshes[o->mesh].triangle_count;
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY}, place[3], near = 1.0;
    if (!is_plain(scene, o))
        return 0.0;
    for (uint64_t c = 0; c < corners; c++) {
        place_of(scene, o, c, place);
        for (int a = 0; a < 3; a++) {
            low[a] = fmin(low[a], place[a]);
            high[a] = fmax(high[a], place[a]);
        }
    }
    for (int a = 0; a < 3; a++) {
        const double inside = fmax(fmin(high[a], detail->high[a]) - fmax(low[a], detail->low[a]), 0.0);
        near *= high[a] > low[a] && detail->high[a] > detail->low[a] ? inside / (high[a] - low[a]) : 1.0;
    }
    return 1.0 - near;
}

static double far_share(const struct kiln_scene *scene, double triangles, double covered)
{
    const struct extent detail = detail_of(scene, triangles);
    double far = 0.0;
    for (size_t i = 0; i < scene->object_count; i++)
        far += far_part(scene, &scene->objects[i], &detail) * kiln_work_points_of(scene, i);
    return covered > 0.0 ? far / covered : 0.0;
}

/* Whether a sun or an environment shines. */
static bool is_lit_from_afar(const struct kiln_scene *scene)
{
    bool lit = scene->environment != NULL && scene->environment->kind != KILN_ENVIRONMENT_NONE;
    for (size_t i = 0; i < scene->light_count; i++)
        lit = lit || scene->lights[i].kind == KILN_LIGHT_DIRECTIONAL;
    return lit;
}

static void count_surface(struct kiln_work *w, const struct kiln_job *job, const struct kiln_scene *scene,
                          double points)
{
    double covered = 0.0;
    for (size_t i = 0; i < scene->object_count; i++) {
        const struct kiln_object *o = &scene->objects[i];
        w->triangles += (double)scene->meshes[o->mesh].triangle_count;
        w->texels += (double)o->lightmap_width * (double)o->lightmap_height;
        covered += kiln_work_points_of(scene, i);
    }
    w->points = points > 0.0 ? points : kiln_work_points(scene, job->lightmaps.both_sides);
    w->far = far_share(scene, w->triangles, covered);
    count_materials(w, scene, covered);
    for (size_t i = 0; i < scene->material_count; i++) {
        const struct kiln_material *m = &scene->materials[i];
        w->textured = w->textured || m->base_color_texture != KILN_NONE;
        w->cut_out = w->cut_out || m->alpha_mode != KILN_ALPHA_OPAQUE || m->transmission > 0.0f;
    }
    w->from_afar = is_lit_from_afar(scene);
}

/* ---- light ---- */

uint32_t kiln_work_bounces(const struct kiln_job *job, const struct kiln_scene *scene)
{
    if (job->light.bounces >= 0)
        return (uint32_t)job->light.bounces;
    if (job->light.patches.order == KILN_ORDER_UNSHOT)
        return TYPICAL_UNSHOT;
    return job->light.schedule == KILN_SCHEDULE_EQUAL        ? TYPICAL_EQUAL
           : scene->taken != NULL || is_lit_from_afar(scene) ? TYPICAL_HARD
                                                             : TYPICAL_BOUNCES;
}

/* Gather rays of a point of full resolution: companions let one point gather for several. */
static double points_of_step(const struct kiln_work *w, const struct kiln_integrate_settings *settings,
                             const struct kiln_step *step)
{
    const double side = kiln_step_has(step, KILN_WITH(blocks))  ? settings->indirect_scale
                        : kiln_step_has(step, KILN_WITH(nodes)) ? settings->final_scale
                                                                : 1.0;
    return w->points / (side * side);
}

static enum kiln_work_kind kind_of(const struct kiln_step *step)
{
    return step->quantity != NULL            ? KILN_WORK_QUANTITY
           : step->pass == &kiln_pass_direct ? KILN_WORK_DIRECT
           : step->terminal                  ? KILN_WORK_FINAL
                                             : KILN_WORK_BOUNCE;
}

/* Adds a step of light paths: its first in a bake that tries caustics may be all that there is of them. */
static void count_paths(struct kiln_work *w, const struct kiln_integrate_settings *settings,
                        const struct kiln_step *step)
{
    const double paths = (double)settings->photons * (step->iterations + 1.0); /* pilots are as many as an iteration */
    w->paths_planned += paths;
    if (settings->caustics_tried && settings->published_error > 0.0 && w->gloss < GLOSS_KEPT) {
        w->paths += step->part == 0 ? (double)settings->photons : 0.0; /* typical: they bring too little */
        w->path_steps += step->part == 0 ? 1.0 : 0.0;
        return;
    }
    w->path_steps++;
    w->paths += paths;
    w->shared += settings->caustics == KILN_CAUSTICS_VCM ? w->points * step->samples / RAYS_SHARE : 0.0;
    w->spread += settings->caustics >= KILN_CAUSTICS_MERGE ? w->points : 0.0;
}

static void count_step(struct kiln_work *w, const struct kiln_integrate_settings *settings,
                       const struct kiln_step *step)
{
    if (kiln_step_has(step, KILN_WITH(landing))) {
        count_paths(w, settings, step);
        return;
    }
    if (step->pass == &kiln_pass_patches) { /* faces are seen from half of the others */
        w->pairs += 0.5 * w->points * w->points;
        return;
    }
    struct kiln_work_rays *rays = &w->light[kind_of(step)];
    const double points = points_of_step(w, settings, step);
    rays->samples += points * step->samples * (step->pass == &kiln_pass_reference ? fmax(w->bounces, 1.0) : 1.0);
    rays->visits += points;
    rays->steps++;
}

double kiln_work_caustics(double samples) { return pow(samples, CAUSTICS_POWER); }

/* Adds the rounds after the first, which have no bounces. */
static void count_rounds(struct kiln_work *w, const struct kiln_integrate_settings *settings,
                         const struct kiln_foretold *foretold)
{
    const double asked = settings->published_error > 0.0 ? settings->published_error : settings->target_error;
    const enum kiln_work_kind kinds[] = {KILN_WORK_DIRECT, KILN_WORK_FINAL};
    w->rounds = foretold != NULL && foretold->tried > 0 ? *foretold
                                                        : kiln_rounds_expected(asked, w->takes_gloss || w->from_afar);
    for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++) {
        struct kiln_work_rays *rays = &w->light[kinds[i]];
        rays->samples *= w->rounds.samples;
        rays->visits *= w->rounds.rounds;
        rays->steps *= w->rounds.rounds;
    }
    const double caustics = kiln_work_caustics(w->rounds.samples);
    w->paths *= w->gloss < GLOSS_KEPT ? 1.0 : caustics;
    w->path_steps *= w->gloss < GLOSS_KEPT ? 1.0 : caustics;
    w->shared *= caustics;
    w->spread *= caustics;
}

static int count_light(struct kiln_work *w, const struct kiln_job *job, const struct kiln_integrate_settings *settings,
                       const struct kiln_scene *scene, const struct kiln_foretold *foretold, struct kiln_error *error)
{
    struct kiln_planned_steps steps;
    w->bounces = kiln_work_bounces(job, scene);
    const int status = kiln_planned_steps_make(&steps, settings, w->bounces, error);
    for (size_t i = 0; i < steps.count && status == KILN_OK; i++)
        count_step(w, settings, &steps.of[i].step);
    kiln_planned_steps_release(&steps);
    if (status == KILN_OK && kiln_has_rounds(settings))
        count_rounds(w, settings, foretold);
    return status;
}

/* ---- the rest ---- */

/* Probes, and light paths to them: about as many as gather rays (bake/volume/probe_paths.h). */
static void count_probes(struct kiln_work *w, const struct kiln_job *job,
                         const struct kiln_integrate_settings *settings, const struct kiln_scene *scene)
{
    struct kiln_volume_result volume;
    struct kiln_error ignored; /* too many probes are refused elsewhere */
    if (job->volume.samples == 0 ||
        kiln_volume_grid(&volume, scene, job->volume.spacing, job->volume.bounds, &ignored) != KILN_OK)
        return;
    const double x = (double)volume.size[0], y = (double)volume.size[1], z = (double)volume.size[2],
                 face = fmax(x * y, fmax(y * z, z * x));
    w->probes = x * y * z;
    w->probe_samples = w->probes * job->volume.samples;
    if (settings->caustics >= KILN_CAUSTICS_LAND)
        w->probe_paths = face * job->volume.samples;
}

int kiln_work_count(struct kiln_work *w, const struct kiln_job *job, const struct kiln_integrate_settings *settings,
                    const struct kiln_scene *scene, double points, const struct kiln_foretold *foretold,
                    struct kiln_error *error)
{
    *w = (struct kiln_work){.takes_gloss = kiln_job_takes_gloss(job) && scene->taken != NULL,
                            .denoises = kiln_job_denoises(job)};
    count_surface(w, job, scene, points);
    count_probes(w, job, settings, scene);
    w->preview = job->preview ? kiln_preview_share(job, scene, w->points) : 0.0;
    return count_light(w, job, settings, scene, foretold, error);
}
