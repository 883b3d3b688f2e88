#include "coordinator/bake/prepare/backend_choice.h"

#include <math.h>

#include "coordinator/bake/volume/volume.h"

/* Times of rays, measured once: `kiln bench rays` with AVX-512 and one core per thread, in scenes of 32 and of 262,000
 * triangles; an H200 in scenes of 32, 250,000 and 4 million. Each doubling of the triangles adds about the same time
 * per ray. A GPU ten times slower changes the choice only for bakes that take processors a second or two. The first
 * bake with a GPU compiles its kernels, which takes one or two seconds more. */
static const double EMBREE_RAY = 113e-9, EMBREE_RAY_DOUBLING = 35e-9; /* s of one thread */
static const double VULKAN_RAY = 0.083e-9, VULKAN_RAY_DOUBLING = 0.008e-9;
static const double EMBREE_TRIANGLE = 4e-6;   /* s of one thread, of a BVH */
static const double VULKAN_TRIANGLE = 0.6e-6; /* s of one triangle: building, and copying to the device */
static const double VULKAN_START = 0.4;       /* s: driver and device, with kernels that are kept */
static const double VULKAN_STEP = 0.005;      /* s, per step: dispatches and transfer of results */
enum { FIRST_DOUBLINGS = 5, TYPICAL_BOUNCES = 6, FIRST_BOUNCE = 3, TYPICAL_LEAN = 10 };
/* fraction of lightmap texels on geometry; fraction of shadow rays that are traced */
static const double COVERED = 0.75, LIT = 0.5;

/* Estimates the rays per point. With the lean schedule the first bounce has three times as many as given, later ones
 * fewer: about ten times in all. */
static double rays_of_a_point(const struct kiln_job *job)
{
    const double bounces = job->light.bounces < 0 ? TYPICAL_BOUNCES : (double)job->light.bounces,
                 direct = LIT * job->light.samples_direct;
    if (job->light.schedule == KILN_SCHEDULE_EQUAL || kiln_job_is_reference(job))
        return direct + bounces * job->light.samples_indirect;
    const double lean = fmin(TYPICAL_LEAN, bounces > 0.0 ? FIRST_BOUNCE + bounces - 1.0 : 0.0);
    const double blocks = ldexp(1.0, -2 * job->light.indirect_scale), nodes = ldexp(1.0, -2 * job->light.final_scale);
    return direct + lean * job->light.samples_bounce * blocks +
           (bounces > 0.0 ? job->light.samples_indirect * nodes : 0.0);
}

struct kiln_backend_question kiln_backend_ask(const struct kiln_job *job, const struct kiln_scene *scene,
                                              uint64_t threads, uint32_t ranks)
{
    struct kiln_volume_result volume;
    struct kiln_error ignored; /* too many probes are refused elsewhere */
    uint64_t triangles = 0;
    double texels = 0.0;
    for (size_t i = 0; i < scene->object_count; i++) {
        triangles += scene->meshes[scene->objects[i].mesh].triangle_count;
        texels += (double)scene->objects[i].lightmap_width * (double)scene->objects[i].lightmap_height;
    }
    const double points = COVERED * texels;
    const double each = kiln_job_is_radiosity(job) && job->light.patches.patches != KILN_PATCHES_LINKS
                            ? 0.5 * points /* pairs */
                            : rays_of_a_point(job);
    double rays = points * each;
    if (job->volume.samples > 0 &&
        kiln_volume_grid(&volume, scene, job->volume.spacing, job->volume.bounds, &ignored) == KILN_OK)
        rays += (double)(volume.size[0] * volume.size[1] * volume.size[2]) * job->volume.samples;
    return (struct kiln_backend_question){
        .triangles = triangles, .points = (uint64_t)points, .rays = rays, .threads = threads, .ranks = ranks};
}

void kiln_backend_predict(struct kiln_backend_choice *choice)
{
    const struct kiln_backend_question *q = &choice->question;
    const double triangles = (double)q->triangles, doublings = fmax(log2(fmax(triangles, 1.0)) - FIRST_DOUBLINGS, 0.0);
    const double threads = (double)(q->threads > 0 ? q->threads : 1), ranks = q->ranks > 0 ? q->ranks : 1;
    const double own_threads = threads / ranks; /* each rank builds its own BVH */
    choice->embree_seconds =
        triangles * EMBREE_TRIANGLE / own_threads + q->rays * (EMBREE_RAY + doublings * EMBREE_RAY_DOUBLING) / threads;
    choice->vulkan_seconds = VULKAN_START + (TYPICAL_BOUNCES + 2) * VULKAN_STEP + triangles * VULKAN_TRIANGLE +
                             q->rays * (VULKAN_RAY + doublings * VULKAN_RAY_DOUBLING) / ranks;
    choice->processors = choice->embree_seconds < choice->vulkan_seconds;
}
