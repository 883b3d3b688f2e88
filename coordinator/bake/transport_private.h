/* Shared by transport.c (what comes after what), pass.c (one pass over all own points) and transport_save.c (checkpoints). */
#ifndef KILN_COORDINATOR_BAKE_TRANSPORT_PRIVATE_H
#define KILN_COORDINATOR_BAKE_TRANSPORT_PRIVATE_H

#include "coordinator/bake/transport.h"

enum { FINAL_STREAM = 0xffff };

/* Sums that a pass makes over its points; by channel. */
enum { SUM_INCIDENT = 0, SUM_REFLECTED = 3, SUM_SENT = 6, SUM_ESCAPED = 9, SUM_BLOCKED = 12, SUM_BEHIND = 15, SUM_BORROWED = 18, SUM_COUNT = 21 };

/* Groups are made of tiles, not of cells: the cell size must not change a result. */
enum { GROUP_TILES = 16 };

struct transport_state;

/* What a pass does with a point's answer: gives the radiosity it has now. */
typedef void (*take_point)(struct transport_state *s, uint64_t own, const struct kiln_point_result *result, float radiosity[3]);

/* A pass, before it is run: kind and bounce say all, given the job. */
struct transport_step {
    enum kiln_pass_kind kind;
    uint32_t bounce, samples, stream;
    take_point take;
};

/* A range of own fragments. */
struct fragment_range {
    size_t first, count;
};

struct transport_state {
    const struct kiln_transport_params *params;
    struct kiln_transport *out;
    float *sum;      /* own: radiosity of all bounces so far, 3 a point; becomes out->indirect */
    uint64_t *next;  /* own: packed radiosity of the present bounce */
    bool compact;    /* `next` holds values of the 4-byte form: see radiosity.h */
    bool early;      /* and they leave while the pass goes on */
    double scale;    /* of that form */
    double unit, unit_squared; /* of the exact sums: of power, of its variance */
    /* reflected power, luminance, of groups of tiles: the present bounce's (all ranks' when the pass is over), the one's before,
     * and the sum of all; group_count each */
    size_t group_count;
    struct kiln_exact_sum *group_now;
    double *group_before, *group_total;
    /* the pass under way, so far */
    struct transport_step step;
    struct kiln_exact_sum sums[SUM_COUNT], variance;
    struct fragment_range *todo; /* from todo_first on; ranges in order */
    size_t todo_first, todo_count, todo_room;
    uint64_t points_done;
    double rate; /* rays a second, as far as is known */
};

double kiln_luminance(const double rgb[3]);

/* The steps of a job. */
void transport_step_make(const struct transport_state *s, enum kiln_pass_kind kind, uint32_t bounce, struct transport_step *step);

/* Rounding of a texel's radiosity: by what the texel is, never by where it stands in the global order. */
uint32_t transport_pack_hash(const struct kiln_fragment *f, uint32_t bit, uint32_t stream);
void transport_albedo(const struct kiln_surface *surface, uint64_t own, float albedo[3]);

/* Collective (pass.c). Begins s->step as the report's next pass, with all own fragments to do. */
int transport_pass_begin(struct transport_state *s, struct kiln_error *error);
/* Collective. Does what is to do in s->step, the report's last pass, which gets this rank's time and the energies of all ranks. */
int transport_pass_run(struct transport_state *s, struct kiln_error *error);

/* Collective (transport_save.c). Writes a checkpoint: at any time within s->step, or with `finished` after the last (when radiosities and
 * groups are of no more use). */
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
