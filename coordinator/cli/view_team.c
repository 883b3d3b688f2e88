#include "coordinator/cli/view_team.h"

#include <math.h>
#include <mpi.h>
#include <omp.h>
#include <stdio.h>
#include <string.h>

#include "coordinator/bake/prepare/devices.h"
#include "coordinator/bake/prepare/prepare.h"
#include "coordinator/cli/view_rounds.h"
#include "coordinator/mpi/agree.h"
#include "coordinator/view/view_radius.h"
#include "worker/base/memory.h"

/* Most paths per pixel for the view that chooses the exposure: a mean over a picture needs few. */
enum { METER_SAMPLES = 16 };

/* Initial merge radius, in pixels. vcm uses merging only where it is better than connections, which works best with a
 * small radius. Photon mapping has nothing but merging. */
static const double RADIUS_VCM = 0.5, RADIUS_PHOTONS = 1.0;

struct kiln_view_team {
    int rank, ranks;
    int64_t bounces;
    uint32_t samples, path_length;      /* as in the job */
    double lens_radius, focus_distance; /* m; as in the job */
    int method;                         /* enum kiln_view_method */
    double radius;                      /* initial merge radius, m; 0: derived from each picture */
    const struct kiln_scene *scene;
    const char *instruction_set;
    struct kiln_geometry *geometry;
    struct kiln_lights *lights;
    struct kiln_backend *backend;
    struct kiln_view_rounds *rounds; /* NULL: paths are traced without */
    struct kiln_view_renderer renderer;
    struct kiln_view_work work;
    double begin; /* MPI_Wtime() when the picture began */
    /* rank 0: asks how much of the picture is drawn; NULL: nobody does. Its fraction before this draw, and of it */
    void (*tell)(void *context, double share);
    void *tell_context;
    double before, part;
    bool has_kernels; /* the device has made them */
};

/* Order from rank 0 to the others. */
struct order {
    struct kiln_path_view view;
    uint32_t ends; /* 1: there is nothing more to do */
    uint32_t reserved;
};

/* ---- begin and end ---- */

/* Chooses the best of Embree's instruction sets that all ranks have, or the given one. */
static int choose_instruction_set(const struct kiln_job *job, const char **chosen, struct kiln_error *error)
{
    static const char *const sets[] = {"avx512", "avx2", "avx", "sse4.2", "sse2"};
    const char *best = NULL;
    for (size_t i = 0; i < sizeof sets / sizeof *sets && best == NULL; i++)
        if (kiln_instruction_set_common(MPI_COMM_WORLD, sets[i]))
            best = sets[i];
    *chosen = job->machine.instruction_set != NULL ? job->machine.instruction_set : best;
    if (job->machine.instruction_set == NULL ||
        kiln_instruction_set_common(MPI_COMM_WORLD, job->machine.instruction_set))
        return KILN_OK;
    return kiln_fail(error, KILN_NO_DEVICE, "instruction set %s is not available on every rank; all have %s",
                     job->machine.instruction_set, best != NULL ? best : "none");
}

static int open_backend(struct kiln_view_team *t, const struct kiln_job *job, const struct kiln_scene *scene,
                        const char *instruction_set, const int of_node[2], struct kiln_error *error)
{
    int status = kiln_geometry_create(&t->geometry, scene, error);
    if (status == KILN_OK)
        status = kiln_lights_create(&t->lights, scene, t->geometry, error);
    if (status != KILN_OK)
        return status;
    struct kiln_backend_params params = {.scene = scene,
                                         .geometry = t->geometry,
                                         .lights = t->lights,
                                         .threads = (uint32_t)omp_get_max_threads(),
                                         .instruction_set = instruction_set,
                                         .seed = job->light.seed};
    kiln_devices_choose(job, of_node[0], of_node[1], &params);
    const bool both_ways = kiln_view_is_bidirectional(job->view.method);
    if (both_ways && params.traversal == KILN_TRAVERSE_AUTO)
        params.traversal = KILN_TRAVERSE_COMPUTE; /* of which more is known */
    return kiln_backend_create(&t->backend, job->machine.backend, &params, error);
}

/* Collective. Finds this rank's number among the ranks of its node, and their number. */
static void learn_node(int of_node[2])
{
    MPI_Comm node;
    (void)MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, 0, MPI_INFO_NULL, &node);
    (void)MPI_Comm_rank(node, &of_node[0]);
    (void)MPI_Comm_size(node, &of_node[1]);
    (void)MPI_Comm_free(&node);
}

static int render(void *context, const struct kiln_view_params *params, struct kiln_image **image,
                  struct kiln_error *error);

int kiln_view_team_create(struct kiln_view_team **team, const struct kiln_job *job, const struct kiln_scene *scene,
                          int opened, struct kiln_error *error)
{
    const char *instruction_set = NULL;
    int of_node[2];
    *team = NULL;
    int status = opened == KILN_OK ? kiln_allocate(team, 1, sizeof **team, "a view", error) : opened;
    status = kiln_agree(MPI_COMM_WORLD, status, error);
    if (status == KILN_OK)
        status = choose_instruction_set(job, &instruction_set, error);
    if (status == KILN_OK) {
        struct kiln_view_team *t = *team;
        learn_node(of_node);
        omp_set_num_threads((int)(job->machine.threads != 0 ? job->machine.threads : kiln_own_cores(of_node[1])));
        (void)MPI_Comm_rank(MPI_COMM_WORLD, &t->rank);
        (void)MPI_Comm_size(MPI_COMM_WORLD, &t->ranks);
        t->bounces = job->light.bounces;
        t->samples = job->view.samples_pixel;
        t->path_length = job->view.path_length;
        t->lens_radius = job->view.lens_radius;
        t->focus_distance = job->view.focus_distance;
        t->method = job->view.method;
        t->radius = job->light.merge_radius;
        t->scene = scene;
        t->instruction_set = instruction_set;
        t->renderer = (struct kiln_view_renderer){render, t};
        status = kiln_agree(MPI_COMM_WORLD, open_backend(t, job, scene, instruction_set, of_node, error), error);
        if (status == KILN_OK)
            status = kiln_view_rounds_create(&t->rounds, job, error);
    }
    if (status != KILN_OK)
        kiln_view_team_destroy(team);
    return status;
}

void kiln_view_team_destroy(struct kiln_view_team **team)
{
    if (*team == NULL)
        return;
    kiln_view_rounds_destroy(&(*team)->rounds);
    kiln_backend_destroy(&(*team)->backend);
    kiln_lights_destroy(&(*team)->lights);
    kiln_geometry_destroy(&(*team)->geometry);
    kiln_free(team);
}

void kiln_view_team_lend(struct kiln_view_team *team, struct kiln_view_source *source)
{
    source->geometry = team->geometry;
    source->lights = team->lights;
    source->backend = team->backend;
    source->renderer = &team->renderer;
}

struct kiln_view_work kiln_view_team_work(const struct kiln_view_team *team) { return team->work; }

int kiln_view_team_stopped(const struct kiln_view_team *team, struct kiln_error *error)
{
    return kiln_view_rounds_stopped(team->rounds, error);
}

/* ---- pictures ---- */

static void tell(void *context, double share)
{
    const struct kiln_view_team *t = context;
    if (t->tell != NULL)
        t->tell(t->tell_context, t->before + t->part * share);
}

/* The first pixel of a rank's range. */
static size_t range_of(const struct kiln_view_team *t, size_t pixels, int rank)
{
    return pixels / (size_t)t->ranks * (size_t)rank + pixels % (size_t)t->ranks * (size_t)rank / (size_t)t->ranks;
}

/* Collective. All ranks' pixels, in order, on rank 0. A picture has at most 2^30 pixels, which an int counts. */
static int gather(const struct kiln_view_team *t, size_t pixels, const float *own, float *all, struct kiln_error *error)
{
    MPI_Datatype pixel;
    int *counts = NULL;
    const size_t ranks = (size_t)t->ranks;
    int status =
        kiln_agree(MPI_COMM_WORLD, kiln_allocate(&counts, 2 * ranks, sizeof *counts, "the ranks", error), error);
    for (int r = 0; r < t->ranks && status == KILN_OK; r++) {
        counts[r] = (int)(range_of(t, pixels, r + 1) - range_of(t, pixels, r));
        counts[t->ranks + r] = (int)range_of(t, pixels, r);
    }
    if (status == KILN_OK) {
        (void)MPI_Type_contiguous(3, MPI_FLOAT, &pixel);
        (void)MPI_Type_commit(&pixel);
        (void)MPI_Gatherv(own, counts[t->rank], pixel, all, counts, counts + t->ranks, pixel, 0, MPI_COMM_WORLD);
        (void)MPI_Type_free(&pixel);
    }
    kiln_free(&counts);
    return status;
}

/* Traces one path, so that the device compiles its kernels before the limited computing time begins. An error is
 * ignored: the picture will fail with the same one. */
static void make_kernels(struct kiln_view_team *t, const struct kiln_path_view *view)
{
    struct kiln_path_view one = *view;
    struct kiln_backend_info info;
    int64_t sums[3] = {0, 0, 0};
    struct kiln_splat_film film = {sums, 0.0};
    float pixel[3];
    uint64_t rays = 0;
    kiln_backend_info(t->backend, &info);
    one.samples = 1;
    one.parameters.width = one.parameters.height = 1;
    if (!t->has_kernels && info.makes_kernels)
        (void)kiln_path_view_pixels(t->backend, &one, 0, 1, NULL, &film, pixel, NULL, &rays, NULL);
    t->has_kernels = true;
}

/* Collective. Traces the paths of this rank's range. */
static int trace(struct kiln_view_team *t, const struct kiln_path_view *view, struct kiln_path_sums *sums,
                 struct kiln_splat_film *film, uint64_t *rays, struct kiln_error *error)
{
    const struct kiln_view_traced traced = {.backend = t->backend,
                                            .scene = t->scene,
                                            .instruction_set = t->instruction_set,
                                            .view = view,
                                            .progress = {.tell = tell, .context = t}};
    if (t->rounds != NULL)
        return kiln_view_rounds_trace(t->rounds, &traced, sums, film, rays, error);
    return kiln_agree(MPI_COMM_WORLD,
                      kiln_path_sums_add(sums, t->backend, view, view->samples, &traced.progress, film, rays, error),
                      error);
}

/* Collective. Draws a picture; `all` has its pixels, on rank 0. */
static int draw(struct kiln_view_team *t, const struct kiln_path_view *view, float *all, struct kiln_error *error)
{
    make_kernels(t, view);
    const size_t pixels = (size_t)view->parameters.width * view->parameters.height;
    const size_t first = range_of(t, pixels, t->rank), count = range_of(t, pixels, t->rank + 1) - first;
    struct kiln_splat_film film = {NULL, 0.0};
    struct kiln_path_sums sums = {0};
    float *own = NULL;
    uint64_t rays = 0;
    t->begin = MPI_Wtime();
    int status = kiln_allocate(&own, 3 * count, sizeof *own, "the pixels of a view", error);
    if (status == KILN_OK)
        status = kiln_path_sums_create(&sums, first, count, error);
    if (status == KILN_OK && view->both_ways)
        status = kiln_allocate(&film.sums, 3 * pixels, sizeof *film.sums, "the pixels of a view", error);
    status = kiln_agree(MPI_COMM_WORLD, status, error);
    if (status == KILN_OK)
        status = trace(t, view, &sums, view->both_ways ? &film : NULL, &rays, error);
    if (status == KILN_OK) {
        kiln_path_sums_develop(&sums, own, NULL);
        status = gather(t, pixels, own, all, error);
    }
    if (status == KILN_OK && view->both_ways)
        kiln_view_add_films(&film, pixels);
    if (status == KILN_OK && view->both_ways && t->rank == 0)
        kiln_path_view_add_film(view, sums.samples, &film, all);
    (void)MPI_Allreduce(MPI_IN_PLACE, &rays, 1, MPI_UINT64_T, MPI_SUM, MPI_COMM_WORLD);
    t->work.rays += rays;
    t->work.samples = sums.samples;
    t->work.seconds += MPI_Wtime() - t->begin;
    kiln_path_sums_destroy(&sums);
    kiln_free(&own);
    kiln_free(&film.sums);
    return status;
}

/* Finds the distance, along the camera's axis, of the surface in the middle of the picture; the scene's extent if there
 * is none. */
static int find_focus(const struct kiln_view_team *t, const struct kiln_view_camera *camera, double *distance,
                      struct kiln_error *error)
{
    const struct kiln_vec3 origin = vec3_of(camera->position), direction = vec3_of(camera->forward);
    struct kiln_hit hit;
    const int status = kiln_backend_intersect(t->backend, &origin, &direction, 1, &hit, error);
    *distance = status == KILN_OK && hit.triangle != KILN_NONE ? (double)hit.distance : (double)t->geometry->extent;
    return status;
}

/* Gives the view its lens. */
static int mount_lens(const struct kiln_view_team *t, const struct kiln_view_camera *camera,
                      struct kiln_path_parameters *parameters, struct kiln_error *error)
{
    double distance = t->focus_distance;
    if (!(t->lens_radius > 0.0))
        return KILN_OK;
    if (camera->orthographic)
        return kiln_fail(error, KILN_USAGE,
                         "--lens-radius %g: the camera is orthographic and has no lens; leave it out", t->lens_radius);
    const int status = distance > 0.0 ? KILN_OK : find_focus(t, camera, &distance, error);
    parameters->lens_radius = (float)t->lens_radius;
    parameters->focus_distance = (float)distance;
    return status;
}

/* Sets the merge radius of a view whose method merges. */
static int choose_radius(struct kiln_view_team *t, const struct kiln_view_params *params, struct kiln_path_view *view,
                         struct kiln_error *error)
{
    const double pixels = t->method >= KILN_VIEW_METHOD_ppm ? RADIUS_PHOTONS : RADIUS_VCM;
    double width = 0.0;
    int status = KILN_OK;
    if (!(t->radius > 0.0) && t->method >= KILN_VIEW_METHOD_vcm)
        status = kiln_view_pixel_width(t->backend, t->geometry, params, &width, error);
    view->radius = t->radius > 0.0 ? t->radius : pixels * width; /* 0: nothing is merged */
    t->work.radius = view->radius;
    return status;
}

/* Numbers the paths of a frame, starting after those of earlier frames. */
static int count_samples(uint32_t frame, struct kiln_path_view *view, struct kiln_error *error)
{
    const uint64_t first = (uint64_t)frame * view->samples;
    view->first = (uint32_t)first;
    return first + view->samples <= UINT32_MAX
               ? KILN_OK
               : kiln_fail(error, KILN_USAGE,
                           "--samples-pixel %u: frame %u would have path 2^32 of a pixel; give fewer", view->samples,
                           frame + 1);
}

/* On rank 0: draws with all ranks. */
static int draw_with_all(struct kiln_view_team *t, const struct order *order, float *all, struct kiln_error *error)
{
    struct order sent = *order;
    (void)MPI_Bcast(&sent, (int)sizeof sent, MPI_BYTE, 0, MPI_COMM_WORLD);
    return draw(t, &order->view, all, error);
}

/* Draws a picture in two halves. `all` receives their mean, and `spread` the difference as struct kiln_view_params
 * defines it. */
static int draw_halves(struct kiln_view_team *t, const struct order *order, size_t values, float *all, float *spread,
                       struct kiln_error *error)
{
    struct order half = *order;
    half.view.samples = order->view.samples / 2;
    t->part = 0.5;
    int status = draw_with_all(t, &half, spread, error);
    const double first = half.view.samples;
    t->before = 0.5;
    half.view.first += half.view.samples;
    half.view.samples = order->view.samples - half.view.samples;
    if (status == KILN_OK)
        status = draw_with_all(t, &half, all, error);
    const double second = half.view.samples;
    for (size_t i = 0; i < values && status == KILN_OK; i++) {
        const double mean = (first * (double)spread[i] + second * (double)all[i]) / (first + second);
        spread[i] = (float)(((double)spread[i] - mean) * sqrt(first / second));
        all[i] = (float)mean;
    }
    return status;
}

/* Implements struct kiln_view_renderer on rank 0; the other ranks run kiln_view_team_serve in step with it. */
static int render(void *context, const struct kiln_view_params *params, struct kiln_image **image,
                  struct kiln_error *error)
{
    static const char *const names[] = {"R", "G", "B", "spread.R", "spread.G", "spread.B"};
    struct kiln_view_team *t = context;
    const uint32_t samples = params->side == 1 && t->samples > METER_SAMPLES ? METER_SAMPLES : t->samples;
    struct order order = {.view =
                              kiln_path_view_of(&params->camera, params->width, params->height, t->bounces, samples)};
    order.view.both_ways = kiln_view_is_bidirectional(t->method);
    if (order.view.both_ways)
        order.view.method = (enum kiln_bidirectional_method)(t->method - KILN_VIEW_METHOD_light);
    order.view.parameters.length = t->path_length;
    const bool halves = params->spread && samples > 1;
    const size_t values = 3 * (size_t)params->width * params->height;
    float *all = NULL, *spread = NULL, *planes[3], *spread_planes[3];
    int status;
    t->tell = params->side == 1 ? NULL : params->source.tell; /* metering is soon done */
    t->tell_context = params->source.tell_context;
    t->before = 0.0;
    t->part = 1.0;
    KILN_TRY(count_samples(params->frame, &order.view, error));
    KILN_TRY(choose_radius(t, params, &order.view, error));
    KILN_TRY(mount_lens(t, &params->camera, &order.view.parameters, error));
    KILN_TRY(kiln_image_create(image, params->width, params->height, names, halves ? 6 : 3, error));
    KILN_TRY(kiln_allocate(&all, values, sizeof *all, "the pixels of a view", error));
    if (halves)
        KILN_TRY(kiln_allocate(&spread, values, sizeof *spread, "the pixels of a view", error));
    KILN_TRY(halves ? draw_halves(t, &order, values, all, spread, error) : draw_with_all(t, &order, all, error));
end:
    if (status == KILN_OK) {
        (void)kiln_image_rgb(*image, "", planes);
        (void)kiln_image_rgb(*image, "spread.", spread_planes);
        for (size_t i = 0; i < values; i++) {
            planes[i % 3][i / 3] = all[i];
            if (halves)
                spread_planes[i % 3][i / 3] = spread[i];
        }
    } else {
        kiln_image_destroy(image);
    }
    kiln_free(&all);
    kiln_free(&spread);
    return status;
}

void kiln_view_team_end(struct kiln_view_team *team)
{
    struct order order = {.ends = 1};
    (void)team;
    (void)MPI_Bcast(&order, (int)sizeof order, MPI_BYTE, 0, MPI_COMM_WORLD);
}

void kiln_view_team_serve(struct kiln_view_team *team)
{
    struct order order;
    for (;;) {
        (void)MPI_Bcast(&order, (int)sizeof order, MPI_BYTE, 0, MPI_COMM_WORLD);
        if (order.ends != 0)
            return;
        (void)draw(team, &order.view, NULL, NULL); /* a failure is the same on all ranks, and rank 0 reports it */
    }
}
