/* Light that paths leave in spheres, kept by each thread while it traces, and then added up. One thread adds up each
 * stretch of spheres, so that no two write to one sum. */
#ifndef KILN_WORKER_BACKEND_EMBREE_SPHERE_SUMS_H
#define KILN_WORKER_BACKEND_EMBREE_SPHERE_SUMS_H

#include "worker/base/arena.h"
#include "worker/base/status.h"
#include "worker/pass/spheres.h"
#include "worker/sampling/harmonics.h"

_Static_assert(KILN_SPHERE_WEIGHTS == KILN_HARMONICS + 6, "harmonics and axes");

/* Finds the weights of light from unit direction d: harmonics, and irradiance along +x -x +y -y +z -z. */
static inline void spheres_weights(struct kiln_dvec3 d, double weights[KILN_SPHERE_WEIGHTS])
{
    const double along[3] = {d.x, d.y, d.z};
    kiln_harmonics(d, weights);
    for (int a = 0; a < 3; a++) {
        weights[KILN_HARMONICS + 2 * a] = along[a] > 0.0 ? along[a] : 0.0;
        weights[KILN_HARMONICS + 2 * a + 1] = along[a] < 0.0 ? -along[a] : 0.0;
    }
}

/* A chord through a sphere. */
struct sphere_chord {
    uint32_t sphere;
    struct kiln_vec3 direction; /* that the light goes, unit */
    double brought[3];          /* flux x length, W m */
};
_Static_assert(sizeof(struct sphere_chord) == 40, "a chord has no gaps");

/* Chords of one thread; zero at first. */
struct sphere_chords {
    struct sphere_chord *chords;
    size_t count, room;
    /* the part of a path under way, from 1 on, and the last one that has looked at each sphere */
    uint32_t part, *last;
    /* chords by stretches of spheres: where those of each begin, and one more */
    uint32_t *begin, *order;
    /* second moments of an aim that are not in the spheres' yet */
    size_t aim;
    uint64_t moments;
    int status; /* of memory */
    struct kiln_error error;
    struct kiln_arena arena;
};

/* KILN_SYSTEM. Release with sphere_chords_release, in any case. */
int sphere_chords_begin(struct sphere_chords *c, const struct kiln_probe_spheres *spheres, struct kiln_error *error);
void sphere_chords_release(struct sphere_chords *c);

/* On failure `status` says so. */
void sphere_chords_add(struct sphere_chords *c, const struct sphere_chord *chord);
/* Adds to the moments of an aim, by one thread; those of the last one with sphere_chords_end. */
void sphere_chords_note(struct sphere_chords *c, const struct kiln_probe_spheres *spheres, size_t aim, uint64_t moment);

/* Ends the thread's tracing: sorts its chords. */
void sphere_chords_end(struct sphere_chords *c, const struct kiln_probe_spheres *spheres);

/* When all threads have ended: adds their chords of stretch number `stretch` to the spheres' sums. */
size_t sphere_stretches(const struct kiln_probe_spheres *spheres);
void sphere_stretch_add(const struct kiln_probe_spheres *spheres, const struct sphere_chords *threads, size_t count,
                        size_t stretch);

#endif
