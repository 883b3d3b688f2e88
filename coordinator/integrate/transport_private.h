/* Shared by transport.c (what comes after what), pass.c (one pass over all own points), batches.c (who computes what of
 * it when), rebalance.c (node_data cut anew between passes) and transport_save.c (checkpoints). */
#ifndef KILN_COORDINATOR_INTEGRATE_TRANSPORT_PRIVATE_H
#define KILN_COORDINATOR_INTEGRATE_TRANSPORT_PRIVATE_H

#include "coordinator/integrate/transport.h"
#include "worker/pass/direct.h"
#include "worker/pass/gather.h"
#include "worker/sampling/keys.h"

enum { FINAL_STREAM = 0xffff };

/* Sums that a pass makes over its points; by channel. */
enum {
    SUM_INCIDENT = 0,
    SUM_REFLECTED = 3,
    SUM_SENT = 6,
    SUM_ESCAPED = 9,
    SUM_BLOCKED = 12,
    SUM_GLASS = 15,
    SUM_COUNT = 18
};

/* Groups are made of tiles, not of cells: the cell size must not change a result. */
enum { GROUP_TILES = 16 };

struct transport_state;

/* What a pass does with the answer of a share's point: gives the radiosity it has now. */
typedef void (*take_point)(const struct kiln_rank_data *share, uint64_t own, const struct kiln_point_result *result,
                           float radiosity[3]);

/* A pass, before it is run: kind and bounce say all, given the job. */
struct transport_step {
    enum kiln_pass_kind kind;
    uint32_t bounce, samples, stream;
    take_point take;
};

struct transport_state {
    const struct kiln_transport_params *params;
    struct kiln_transport *out;
    const struct kiln_rank_data *own; /* `sum` is the radiosity of all bounces so far, and becomes out->indirect */
    bool compact;                     /* `next` holds values of the 4-byte form: see radiosity.h */
    bool early;                       /* and they leave while the pass goes on */
    double scale;                     /* of that form */
    double unit, unit_squared;        /* of the exact sums: of power, of its variance */
    /* reflected power, luminance, of groups of tiles: the present bounce's (all ranks' when the pass is over), the
     * one's before, and the sum of all; group_count each */
    size_t group_count;
    struct kiln_exact_sum *group_now;
    double *group_before, *group_total;
    /* the pass under way, so far */
    struct transport_step step;
    struct kiln_exact_sum sums[SUM_COUNT], variance;
    /* from todo_first on; ranges in order. What is left of the first one is on the own queue */
    struct kiln_range *todo;
    size_t todo_first, todo_count, todo_room;
    uint64_t points_done; /* own ones, by this rank or by earlier runs */
    size_t sent;          /* own tile runs before this one are done, as far as was seen */
    /* there are gaps before the present range: others have not returned what they took of one before it */
    bool held;
    bool measured;         /* the costs of all own tile runs are of the last pass */
    bool cuts_anew;        /* shares may be cut anew; the same on all ranks */
    double rate;           /* rays a second, as far as is known */
    uint32_t take_threads; /* that take answers over */
    double slowness;       /* how many times the time of a batch it shall take */
};

double kiln_luminance(const double rgb[3]);

/* The steps of a job. */
void transport_step_make(const struct transport_state *s, enum kiln_pass_kind kind, uint32_t bounce,
                         struct transport_step *step);

/* Rounding of a texel's radiosity: by what the texel is, never by where it stands in the global order. */
static inline uint32_t transport_pack_hash(const struct kiln_tile_run *f, uint32_t bit, uint32_t stream)
{
    return kiln_hash2(kiln_hash2(f->map, f->tile), stream * KILN_TILE_TEXELS + bit);
}

static inline void transport_albedo(const struct kiln_surface *surface, uint64_t own, float albedo[3])
{
    for (int c = 0; c < 3; c++)
        albedo[c] = (float)surface->albedo[3 * own + (uint64_t)c] * (1.0f / 65535.0f);
}

/* Room for so many passes in a report (pass.c). */
int transport_make_room(struct kiln_transport_report *report, size_t passes, struct kiln_error *error);
/* Collective (pass.c). Begins s->step as the report's next pass, with all own tile runs to do. */
int transport_pass_begin(struct transport_state *s, struct kiln_error *error);
/* Collective. Does what is to do in s->step, the report's last pass, which gets this rank's time and the energies of
 * all ranks. */
int transport_pass_run(struct transport_state *s, struct kiln_error *error);

/* A pass under way. */
struct pass_work {
    struct transport_state *state;
    struct kiln_pass_report *pass;
    const struct kiln_rank_data *share; /* of which a batch is being computed */
    uint64_t points;                    /* of that batch, so far */
    double since;                       /* when the part that is computed now was begun */
    struct tile_run_sum *tile_runs;     /* of the part being taken */
    size_t tile_run_room;
};

/* kiln_take_results of all passes (pass.c); the context is the pass_work. */
int transport_take_part(void *context, size_t first, size_t count, const void *part_results, struct kiln_error *error);

/* batches.c. Within a node a rank that has nothing more to do takes work away from the others (queue.h), as far as
 * their backends can (any_share in kiln_backend_info): it computes a range from the end of another's share, and writes
 * results where the owner would. Sums are exact and belong to whoever makes them, so neither results nor checkpoints
 * know who computed what. */

/* Begins the own queue with what is to do. */
void transport_offer(struct transport_state *s);
/* Collective on the node. Waits until nothing of it is away, and brings s->todo up to date. */
void transport_settle(struct transport_state *s);
/* Collective. Until all ranks are done, or one says otherwise. */
int transport_run_batches(struct pass_work *w, struct kiln_error *error);
/* All own tile runs before `end` are done, but for those that others have: what of them is a whole group may leave. */
void transport_send_done(struct transport_state *s, size_t end);
/* kiln_slow_rank, where it is this one. */
int transport_read_slowness(struct transport_state *s, struct kiln_error *error);

/* Collective (rebalance.c). Before s->step, the next pass, is begun: where the points of the last pass have cost some
 * ranks (or nodes, where ranks help each other) more time than others, and the passes to come would gain more by it
 * than it costs, the global order is cut anew by these costs, between cells (objects) where that is as good. Points and
 * all that is known of them go to their new owners. The direct pass says little about gathers: with bounces to come the
 * first one is waited for. Times settle the cuts, so that these may differ from run to run; results do not. By itself
 * only where every backend takes any share: a device would have to be given all its points again, and the time of its
 * first batches says more about kernels being made than about points. */
int transport_rebalance(struct transport_state *s, struct kiln_error *error);
/* Points the transport to what its shares have now (transport.c). */
void transport_use_shares(struct transport_state *s);

/* Collective (transport_save.c). Writes a checkpoint: at any time within s->step, or with `finished` after the last
 * (when radiosities and groups are of no more use). */
int transport_save(struct transport_state *s, bool finished, struct kiln_error *error);
/* Collective. Saves and returns KILN_STOPPED with its sentence, or why it cannot. */
int transport_stop(struct transport_state *s, bool finished, struct kiln_error *error);
/* Collective. Takes over the open generation: everything but the radiosity of other ranks' points. */
int transport_restore(struct transport_state *s, bool *finished, struct kiln_error *error);
/* Whether s->step's radiosity goes on in 4 bytes, and whether it surely or probably goes on at all. */
void transport_choose_form(struct transport_state *s);
/* Bytes of a checkpoint, of all ranks. */
uint64_t transport_save_bytes(const struct transport_state *s);

#endif
