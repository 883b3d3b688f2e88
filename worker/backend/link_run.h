/* A tile run and its links (worker/pass/links.h), which both backends find and sum in this way: all points descend the
 * tree together, a bit each, and a callback traces visibility of the nodes at which they stop. Points are numbered by
 * their bits in the tile. */
#ifndef KILN_WORKER_BACKEND_LINK_RUN_H
#define KILN_WORKER_BACKEND_LINK_RUN_H

#include "worker/backend/link_lanes.h"

struct kiln_link_run;

/* A visibility query between two points. */
struct kiln_link_sight {
    struct kiln_vec3 from, to; /* places of both points; `from` is the one with the smaller number */
    uint32_t bit, other;       /* bit of the tile's point; place of the other point in the tree's order */
    bool back;                 /* the ray goes from the other point to the tile's point */
};
/* Callback that queries visibility for the points `of` of a link. The answer goes to kiln_link_run_see, at any time
 * before kiln_link_run_drop_unseen. */
typedef int (*kiln_link_ask)(void *context, uint32_t link, uint64_t of, const struct kiln_link_sight *sight,
                             struct kiln_error *error);

/* Pending query whether the point at `bit` sees the target of a link, whose data is being prefetched. */
struct kiln_link_question {
    uint32_t link, bit;
    uint64_t of;
};
enum { KILN_LINK_QUESTIONS = 32 };

/* State of a tile run: zero initially but for the parameters and the callback; release with kiln_link_run_release. */
struct kiln_link_run {
    const struct kiln_links_parameters *p; /* borrowed */
    kiln_link_ask ask;
    void *context; /* argument of `ask` */
    /* masks: points of the tile run; those of them that receive light; points of the whole tile that send light, which
     * share rays, and whose visibility results estimate its uncertainty */
    uint64_t mask, valid, shares;
    uint64_t together[2];             /* points of `shares` whose squares of 2 x 2 and of 4 x 4 are contiguous */
    double texel;                     /* m: the longest edge of a point */
    bool by_first;                    /* errors refer to first light */
    uint8_t bit[KILN_TILE_TEXELS];    /* bits of the points, by their places in the run */
    uint64_t index[KILN_TILE_TEXELS]; /* global index by bit, as in all arrays below */
    struct kiln_patch_receiver receiver[KILN_TILE_TEXELS];
    struct kiln_dvec3 at[KILN_TILE_TEXELS];
    const struct kiln_patch *patch[KILN_TILE_TEXELS];
    struct kiln_link_lanes lanes; /* SIMD data of the same points */
    struct kiln_link_lane_sums sums;
    struct kiln_link_lane_factors factors;
    struct kiln_link_question questions[KILN_LINK_QUESTIONS];
    uint32_t question_count;
    bool summed; /* `sums` belong to the links found, and to this bounce */
    struct kiln_found_links found;
};

void kiln_link_run_release(struct kiln_link_run *run);

/* Enters the points of a tile run, and those of its tile that share their rays. */
void kiln_link_run_enter(struct kiln_link_run *run, const struct kiln_surface *surface,
                         const struct kiln_tile_run *tile_run);
/* Sets the results of the own rays of the point at `bit`, before kiln_link_run_enter_found. */
void kiln_link_run_meet(struct kiln_link_run *run, uint32_t bit, const struct kiln_point_result *gathered);
/* Finds which points have light, and their shading normals, after the points of `found` are known. */
void kiln_link_run_enter_found(struct kiln_link_run *run);
/* Takes kept links of the tile run that was entered. KILN_BAD_INPUT; KILN_SYSTEM. */
int kiln_link_run_take(struct kiln_link_run *run, const struct kiln_kept_links *kept, struct kiln_error *error);

/* Returns the error threshold to which links are opened: e, halved found.opened times. */
double kiln_link_run_error(const struct kiln_link_run *run);
/* Whether rows of kept links are to be closed anew and judged: there is a target, and it has not been done. */
bool kiln_link_run_is_to_judge(const struct kiln_links_parameters *p, const struct kiln_kept_links *kept);

/* Finds links for the error threshold, and queries visibility. */
int kiln_link_run_find(struct kiln_link_run *run, struct kiln_error *error);
/* Enters an answer: the transmittance by colour, if it is not zero. KILN_SYSTEM. */
int kiln_link_run_see(struct kiln_link_run *run, uint32_t link, uint64_t of, const double through[3],
                      struct kiln_error *error);
/* Removes the links that are visible from no point, after all answers. */
void kiln_link_run_drop_unseen(struct kiln_link_run *run);

/* ---- link_sums.c ---- */

/* Sums the light of the links for this bounce, or for first light if by_first is set. */
void kiln_link_run_add(struct kiln_link_run *run);
/* Closes the rows that were summed (normalises their factors). */
void kiln_link_run_close(struct kiln_link_run *run);
/* Whether the target requires finding the links again with half the error; the halved error is then set. */
bool kiln_link_run_opens(struct kiln_link_run *run);

/* Light gathered by a point's links. */
struct kiln_link_sums {
    double incident[3], irradiance[3], variance;
};
/* Returns the sums of the point at `bit`. */
struct kiln_link_sums kiln_link_run_sums(const struct kiln_link_run *run, uint32_t bit);
/* Returns the closed answer of a point; zeros for one without samples. */
struct kiln_point_result kiln_link_answer(const struct kiln_linked_point *point, const struct kiln_link_sums *sums);
/* Returns the multiplier of a point's factors, whose sum is `row`. */
float kiln_link_row_scale(const struct kiln_linked_point *point, double row);

/* Returns the side length, in points, of the squares of points that share one ray to a node: worker/pass/links.h. */
uint32_t kiln_link_shared_by(const struct kiln_link_run *run, uint32_t to);

#endif
