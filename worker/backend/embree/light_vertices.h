/* Vertices of light paths that gather rays connect with (worker/pass/weighed.h). Each of the four quarters of a point's
 * samples has light paths of its own, so that the spread of the quarters has their error too. They are traced where
 * they are needed, by every rank: a function of seed, number and aims alone. Read by several threads at once. */
#ifndef KILN_WORKER_BACKEND_EMBREE_LIGHT_VERTICES_H
#define KILN_WORKER_BACKEND_EMBREE_LIGHT_VERTICES_H

#include "worker/backend/embree/bidirectional_vertex.h"
#include "worker/backend/embree/rays.h"
#include "worker/backend/embree/walk.h"
#include "worker/pass/weighed.h"

/* Where a light path has met gloss. */
struct light_vertex {
    struct vertex v;
    float flux[3];                    /* W, that arrives, over the number of the aim's paths */
    struct kiln_caustic_landing sums; /* as it arrives */
    bool is_first;                    /* of its path */
};

/* In the order of their paths. */
struct light_vertices {
    struct light_vertex *vertices; /* owned: kiln_free */
    double *up_to;                 /* luminance of flux, up to each; owned */
    size_t count, capacity;
    double chance; /* of a surface of a gather ray to be connected with one */
};

struct light_vertex_cache {
    struct light_vertices of[RAY_QUARTERS];
    uint32_t wanted; /* hash of what they are of */
};

/* Adds a vertex; all else is left to light_vertices_want. */
int light_vertices_add(struct light_vertices *list, const struct light_vertex *vertex, struct kiln_error *error);

/* Sets b->light_vertices to what the techniques name; nothing is done where that is there. NULL where they keep none.
 * Not for callers inside parallel regions. KILN_SYSTEM. */
int light_vertices_want(struct embree_backend *b, const struct kiln_caustic_techniques *techniques,
                        struct kiln_error *error);
/* Sets the pointer to NULL, which may be NULL. */
void light_vertices_destroy(struct light_vertex_cache **cache);

/* A connection of a place with a vertex of light. */
struct light_connection {
    const struct light_vertex *light;
    struct kiln_vec3 direction; /* unit, from the place to the vertex */
    double squared;             /* m2, of the distance */
    double chance;              /* of the vertex to be picked */
    struct vertex_scatter far;  /* of the vertex; `i` is the way that light has come */
    double irradiance[3];       /* W/m2 across the direction, over that chance */
};

/* Picks a vertex for a place, in proportion to its flux, by the numbers of this use of the walk: no more than what is
 * above `irradiance` is set. False: chance connects it with none. */
bool light_vertices_pick(const struct light_vertices *list, const struct walk *walk, uint32_t use,
                         struct kiln_vec3 place, struct light_connection *connection);
/* Finds what the vertex sends to the place by a ray that starts at `start` by it, and is counted. False: nothing comes.
 */
bool light_vertices_connect(struct light_connection *connection, struct walk *walk, struct kiln_vec3 start);

#endif
