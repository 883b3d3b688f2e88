/* Light that paths deposit in spheres. Each thread stores its own while tracing; then it is added up. One thread adds
 * up each stretch of spheres, so that no two threads write to one sum. */
#ifndef KILN_WORKER_BACKEND_EMBREE_SPHERE_SUMS_H
#define KILN_WORKER_BACKEND_EMBREE_SPHERE_SUMS_H

#include "worker/base/arena.h"
#include "worker/base/status.h"
#include "worker/pass/spheres.h"
#include "worker/sampling/harmonics.h"

_Static_assert(KILN_SPHERE_WEIGHTS == KILN_HARMONICS + 6, "harmonics and axes");

/* Computes the weights of light from unit direction d: harmonics, and irradiance along +x -x +y -y +z -z. */
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
    struct kiln_vec3 direction; /* direction of the light, unit */
    double brought[3];          /* flux x length, W m */
};
_Static_assert(sizeof(struct sphere_chord) == 40, "a chord has no gaps");

/* Chords of one thread; zero at first. */
struct sphere_chords {
    struct sphere_chord *chords;
    size_t count, room;
    /* number, from 1 on, of the current path segment; and for each sphere the last segment tested against it */
    uint32_t part, *last;
    /* chords sorted by stretches of spheres: begin of each stretch, and the end */
    uint32_t *begin, *order;
    /* aim, and its second moments that are not yet added to the spheres' */
    size_t aim;
    uint64_t moments;
    int status; /* KILN_OK, or out of memory */
    struct kiln_error error;
    struct kiln_arena arena;
};

/* KILN_SYSTEM. Release with sphere_chords_release, in any case. */
int sphere_chords_begin(struct sphere_chords *c, const struct kiln_probe_spheres *spheres, struct kiln_error *error);
void sphere_chords_release(struct sphere_chords *c);

/* Adds a chord; on failure it sets `status`. */
void sphere_chords_add(struct sphere_chords *c, const struct sphere_chord *chord);
/* Adds to the moments of an aim, which one thread collects; sphere_chords_end adds those of the last aim. */
void sphere_chords_note(struct sphere_chords *c, const struct kiln_probe_spheres *spheres, size_t aim, uint64_t moment);

/* Ends the thread's tracing: sorts its chords. */
void sphere_chords_end(struct sphere_chords *c, const struct kiln_probe_spheres *spheres);

/* sphere_stretch_add adds all threads' chords of stretch number `stretch` to the spheres' sums, after all threads have
 * ended. sphere_stretches: number of stretches. */
size_t sphere_stretches(const struct kiln_probe_spheres *spheres);
void sphere_stretch_add(const struct kiln_probe_spheres *spheres, const struct sphere_chords *threads, size_t count,
                        size_t stretch);

#endif
