/* Times of units of work that were measured once, by which kiln_reckon_bake tells a bake's time: one table for each
 * backend, one for what the host does in any case. tests/bench/expected.py holds them against bakes. */
#ifndef KILN_COORDINATOR_BAKE_RECKON_RATES_H
#define KILN_COORDINATOR_BAKE_RECKON_RATES_H

#include "coordinator/bake/reckon/reckon.h"

/* Work of a backend. Seconds: of one thread with Embree, of a device with Vulkan. */
struct kiln_backend_rates {
    /* A gather ray in a scene of 32 triangles, and more for each doubling of the triangles: the first `cached`
     * doublings, and those with which the BVH outgrows the caches. */
    double ray, doubling, cached, doubling_uncached;
    /* Added to a gather ray's 1: where there is gloss; for each unit of its share of the surface; where surfaces have
     * holes or let light pass. */
    double gloss, glossy, cut_out;
    /* Samples of direct light over gather rays: with one lamp, for each doubling of the lamps, and added under a sun or
     * an environment. */
    double direct, direct_lamps, direct_afar;
    double visit,
        visit_triangle; /* a point in a step: prepared, its answer taken; for each triangle a point, up to 4 */
    double step;        /* of a step, besides its points: dispatches, transfer */
    double validity;    /* of a point, over gather rays */
    /* samples of direct light and of final gathers in rounds, which few points have, and each its own number, over
     * those of steps that all points have alike */
    double rounds_direct, rounds_gather;
    double path;            /* a light path that lands */
    double path_step;       /* of a step of light paths, besides these: targets, sorting, exchange */
    double shared;          /* a ray that shares light with such paths, over gather rays */
    double probe_ray;       /* a ray of a probe, over gather rays */
    double probe_path;      /* a light path through the spheres of probes */
    double probe_triangle;  /* a triangle, where light paths to probes need the host's BVH: one thread's */
    double triangle;        /* a triangle of the BVH */
    double denoised;        /* a point that is denoised */
    double denoised_beside; /* the same, of a thread of the host beside a device */
    double kernel;          /* waiting for a kernel that is not kept */
    double start;           /* the driver and the device: the part that nothing hides */
};

/* Work of the host's threads. Seconds of one thread. */
struct kiln_host_rates {
    double start;                    /* libraries, MPI, folder; the end */
    double geometry_alone, geometry; /* a triangle of the geometry: by one thread while others wait; by all */
    double points, point, point_textured, point_triangle; /* surface points: in all; a point; a triangle */
    double valid_point, valid_triangle;                   /* validity, besides its rays */
    double emission, probes;                              /* in all */
    double spread;                                        /* a point over which landings are spread, in a step */
    double texel, texel_triangle; /* lightmaps: a point collected, filled, compressed, read back; charts, seams */
    double h5, h5_point;          /* kiln.h5: in all; a point */
    double judged;                /* a point, in each round: errors, and what tiles need; by one thread */
    /* an unlimited preview: gather rays of Embree; by one thread alone; more where there is gloss */
    double preview_rays, preview_alone, preview_alone_gloss;
    double results; /* scene.glb, volume.hdf, manifest */
    /* fractions of work that one thread does while others wait: before the light; denoising; files */
    double alone_before, alone_denoising, alone_after;
};

extern const struct kiln_backend_rates kiln_backend_rates[KILN_RECKON_BACKENDS];
extern const struct kiln_host_rates kiln_host_rates;

#endif
