#include "coordinator/output/map/charts/chart_graphs.h"

#include <pthread.h>

#include "worker/base/memory.h"

struct shared_graph {
    uint32_t mesh, width, height;
    uint32_t users;
    uint64_t used; /* counter value of the last return; larger is later */
    bool done;     /* made, or not with this error */
    int status;
    struct kiln_error error;
    struct kiln_chart_graph *graph;
    struct shared_graph *next;
};

struct kiln_chart_graphs {
    const struct kiln_scene *scene;
    pthread_mutex_t lock; /* of what follows */
    pthread_cond_t done;
    struct shared_graph *first;
    uint32_t *uses; /* of each mesh, to come: kiln_chart_graphs_expect */
    uint64_t clock;
};

int kiln_chart_graphs_create(struct kiln_chart_graphs **graphs, const struct kiln_scene *scene,
                             struct kiln_error *error)
{
    int status = kiln_allocate(graphs, 1, sizeof **graphs, "the charts of meshes", error);
    if (status != KILN_OK)
        return status;
    status = kiln_allocate(&(*graphs)->uses, scene->mesh_count, sizeof *(*graphs)->uses, "the charts of meshes", error);
    if (status != KILN_OK) {
        kiln_free(graphs);
        return status;
    }
    (*graphs)->scene = scene;
    (void)pthread_mutex_init(&(*graphs)->lock, NULL);
    (void)pthread_cond_init(&(*graphs)->done, NULL);
    return KILN_OK;
}

void kiln_chart_graphs_expect(struct kiln_chart_graphs *graphs, uint32_t mesh) { graphs->uses[mesh]++; }

static void drop(struct shared_graph **link)
{
    struct shared_graph *s = *link;
    *link = s->next;
    kiln_chart_graph_destroy(&s->graph);
    kiln_free(&s);
}

void kiln_chart_graphs_destroy(struct kiln_chart_graphs **graphs)
{
    if (*graphs == NULL)
        return;
    while ((*graphs)->first != NULL)
        drop(&(*graphs)->first);
    (void)pthread_cond_destroy(&(*graphs)->done);
    (void)pthread_mutex_destroy(&(*graphs)->lock);
    kiln_free(&(*graphs)->uses);
    kiln_free(graphs);
}

static struct shared_graph *find(const struct kiln_chart_graphs *g, uint32_t mesh, uint32_t width, uint32_t height)
{
    struct shared_graph *s = g->first;
    while (s != NULL && (s->mesh != mesh || s->width != width || s->height != height || s->status != KILN_OK))
        s = s->next;
    return s;
}

/* Drops the least recently returned unused graphs, while there are too many. Requires the lock. */
static void drop_idle(struct kiln_chart_graphs *g)
{
    for (;;) {
        struct shared_graph **oldest = NULL;
        size_t idle = 0;
        for (struct shared_graph **link = &g->first; *link != NULL; link = &(*link)->next) {
            if ((*link)->users > 0)
                continue;
            idle++;
            oldest = oldest == NULL || (*link)->used < (*oldest)->used ? link : oldest;
        }
        if (idle <= KILN_CHART_GRAPHS_IDLE)
            return;
        drop(oldest);
    }
}

/* Drops the unused graphs of a mesh. Requires the lock. */
static void drop_mesh(struct kiln_chart_graphs *g, uint32_t mesh)
{
    for (struct shared_graph **link = &g->first; *link != NULL;)
        if ((*link)->mesh == mesh && (*link)->users == 0)
            drop(link);
        else
            link = &(*link)->next;
}

/* Makes a graph. Requires the lock, which is released meanwhile. Returns NULL if there is no memory. */
static struct shared_graph *make(struct kiln_chart_graphs *g, uint32_t mesh, uint32_t width, uint32_t height,
                                 struct kiln_error *error)
{
    struct shared_graph *s = NULL;
    if (kiln_allocate(&s, 1, sizeof *s, "the charts of meshes", error) != KILN_OK)
        return NULL;
    *s = (struct shared_graph){.mesh = mesh, .width = width, .height = height, .users = 1, .next = g->first};
    g->first = s;
    (void)pthread_mutex_unlock(&g->lock);
    struct kiln_chart_graph *graph = NULL;
    struct kiln_error own;
    const int status = kiln_chart_graph_create(&graph, g->scene, mesh, width, height, &own);
    (void)pthread_mutex_lock(&g->lock);
    s->graph = graph;
    s->status = status;
    if (status != KILN_OK)
        s->error = own;
    s->done = true;
    (void)pthread_cond_broadcast(&g->done);
    return s;
}

/* With the lock. */
static void release(struct kiln_chart_graphs *g, struct shared_graph *s)
{
    uint32_t *uses = &g->uses[s->mesh];
    s->users--;
    s->used = ++g->clock;
    if (*uses > 0 && --*uses == 0)
        drop_mesh(g, s->mesh);
    drop_idle(g);
}

int kiln_chart_graphs_take(struct kiln_chart_graphs *g, uint32_t mesh, uint32_t width, uint32_t height,
                           const struct kiln_chart_graph **graph, struct kiln_error *error)
{
    (void)pthread_mutex_lock(&g->lock);
    struct shared_graph *s = find(g, mesh, width, height);
    if (s != NULL)
        s->users++;
    else
        s = make(g, mesh, width, height, error);
    while (s != NULL && !s->done)
        (void)pthread_cond_wait(&g->done, &g->lock);
    const int status = s != NULL ? s->status : KILN_SYSTEM;
    if (status == KILN_OK)
        *graph = s->graph;
    else if (s != NULL && error != NULL)
        *error = s->error;
    if (s != NULL && status != KILN_OK)
        release(g, s);
    (void)pthread_mutex_unlock(&g->lock);
    return status;
}

void kiln_chart_graphs_give_back(struct kiln_chart_graphs *g, const struct kiln_chart_graph **graph)
{
    if (*graph == NULL)
        return;
    (void)pthread_mutex_lock(&g->lock);
    struct shared_graph *s = g->first;
    while (s->graph != *graph)
        s = s->next;
    release(g, s);
    (void)pthread_mutex_unlock(&g->lock);
    *graph = NULL;
}

size_t kiln_chart_graphs_held(const struct kiln_chart_graphs *g)
{
    size_t count = 0;
    for (const struct shared_graph *s = g->first; s != NULL; s = s->next)
        count++;
    return count;
}
