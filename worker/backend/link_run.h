/* A tile run and its links (worker/pass/links.h), as both backends find them and add them up: all points go down the
 * tree together, a bit each, and who traces is asked about what they stop at. Points are known by their bits in the
 * tile. */
#ifndef KILN_WORKER_BACKEND_LINK_RUN_H
#define KILN_WORKER_BACKEND_LINK_RUN_H

#include "worker/backend/link_lanes.h"

struct kiln_link_run;

/* Two points of which the one may see the other. */
struct kiln_link_sight {
    struct kiln_vec3 from, to; /* their places: from the one with the lesser number */
    uint32_t bit, other;       /* the tile's point; the place of the other in the tree's order */
    bool back;                 /* from the other */
};
/* Asks whether they do, for the points `of` of a link: the answer goes to kiln_link_run_see, at any time before
 * kiln_link_run_drop_unseen. */
typedef int (*kiln_link_ask)(void *context, uint32_t link, uint64_t of, const struct kiln_link_sight *sight,
                             struct kiln_error *error);

/* Question whether the point at `bit` sees what a link goes to, whose point is on its way from memory. */
struct kiln_link_question {
    uint32_t link, bit;
    uint64_t of;
};
enum { KILN_LINK_QUESTIONS = 32 };

/* Zero but for the parameters and who is asked; release with kiln_link_run_release. */
struct kiln_link_run {
    const struct kiln_links_parameters *p; /* borrowed */
    kiln_link_ask ask;
    void *context; /* of `ask` */
    /* points of the tile run, and those of them that have light; those of the whole tile that send some, which share
     * rays, and say by what they see how sure that is */
    uint64_t mask, valid, shares;
    uint64_t together[2];             /* of `shares`, those whose squares of 2 x 2 and of 4 x 4 lie together */
    double texel;                     /* m: the longest edge of a point */
    bool by_first;                    /* errors are of first light */
    uint8_t bit[KILN_TILE_TEXELS];    /* of the points, by their places in the run */
    uint64_t index[KILN_TILE_TEXELS]; /* global, by bit, as all below */
    struct kiln_patch_receiver receiver[KILN_TILE_TEXELS];
    struct kiln_dvec3 at[KILN_TILE_TEXELS];
    const struct kiln_patch *patch[KILN_TILE_TEXELS];
    struct kiln_link_lanes lanes; /* of the same points */
    struct kiln_link_lane_sums sums;
    struct kiln_link_lane_factors factors;
    struct kiln_link_question questions[KILN_LINK_QUESTIONS];
    uint32_t question_count;
    bool summed; /* these sums are of the links found, and of this bounce */
    struct kiln_found_links found;
};

void kiln_link_run_release(struct kiln_link_run *run);

/* Enters the points of a tile run, and those of its tile that share their rays. */
void kiln_link_run_enter(struct kiln_link_run *run, const struct kiln_surface *surface,
                         const struct kiln_tile_run *tile_run);
/* Enters what the point at `bit` has met by rays of its own, before kiln_link_run_enter_found. */
void kiln_link_run_meet(struct kiln_link_run *run, uint32_t bit, const struct kiln_point_result *gathered);
/* After the points of `found` are known: which of them have light, and their shading normals. */
void kiln_link_run_enter_found(struct kiln_link_run *run);
/* Takes links that are kept, of the tile run that was entered. KILN_BAD_INPUT; KILN_SYSTEM. */
int kiln_link_run_take(struct kiln_link_run *run, const struct kiln_kept_links *kept, struct kiln_error *error);

/* Returns the error that links are opened to: e, halved as many times as found.opened says. */
double kiln_link_run_error(const struct kiln_link_run *run);
/* Whether rows of links that are kept are closed anew, and judged: there is a target, and they have not been. */
bool kiln_link_run_is_to_judge(const struct kiln_links_parameters *p, const struct kiln_kept_links *kept);

/* Finds links for that error, and asks. */
int kiln_link_run_find(struct kiln_link_run *run, struct kiln_error *error);
/* An answer: what comes through, of each colour, where that is not nothing. KILN_SYSTEM. */
int kiln_link_run_see(struct kiln_link_run *run, uint32_t link, uint64_t of, const double through[3],
                      struct kiln_error *error);
/* After all answers. Links that nobody sees anything by go. */
void kiln_link_run_drop_unseen(struct kiln_link_run *run);

/* ---- link_sums.c ---- */

/* Adds up the links of this bounce, or of first light where by_first is set. */
void kiln_link_run_add(struct kiln_link_run *run);
/* Closes the rows that were added up. */
void kiln_link_run_close(struct kiln_link_run *run);
/* Whether the links found are to be found anew, with half the error, which is set then: where the target asks for it.
 */
bool kiln_link_run_opens(struct kiln_link_run *run);

/* Light that a point's links have brought. */
struct kiln_link_sums {
    double incident[3], irradiance[3], variance;
};
/* Returns the sums of the point at `bit`. */
struct kiln_link_sums kiln_link_run_sums(const struct kiln_link_run *run, uint32_t bit);
/* The answer of a point, closed; zeros for one without samples. */
struct kiln_point_result kiln_link_answer(const struct kiln_linked_point *point, const struct kiln_link_sums *sums);
/* Returns the multiplier of a point's factors, whose sum is `row`. */
float kiln_link_row_scale(const struct kiln_linked_point *point, double row);

/* Returns how many points in a row, a square of them, have one ray to a node: worker/pass/links.h. */
uint32_t kiln_link_shared_by(const struct kiln_link_run *run, uint32_t to);

#endif
