/* The links pass: hierarchical radiosity. It computes the light of the patches pass (worker/pass/patches.h) from nodes
 * of a tree over all surface points; each point links to the coarsest nodes that are accurate enough for it (Hanrahan,
 * Salzman and Aupperle, "A Rapid Hierarchical Radiosity Algorithm", SIGGRAPH 1991; Smits, Arvo and Greenberg, "A
 * Clustering Algorithm for Radiosity in Complex Environments", SIGGRAPH 1994; Kahl's tiles, 2023, end where a window
 * ends).
 *
 *     E(i) = sum over links (i, j) of  (B(j) F(i, j) + M(j) . grad F(i, j)) V(i, k(i, j))
 *
 * B is the mean radiosity of the node, by area, and M the mean of radiosity times the offset from its centre: so the
 * sum is exact to the first order in the node's size. M accounts for the nearer part of a node being brighter or darker
 * than the mean; without M light was 1 to 3 % low. No link's light falls below 0. V is the transmittance between the
 * point and k, one of the node's points. A low-discrepancy sequence chooses k, so that neighbouring points use
 * different k and the means over a tile are right. Squares of 2 x 2 or 4 x 4 points of a tile, if in one room, share
 * one ray for V where two or four of a point's edges are shorter than kiln_links_shared times R: their views of the
 * node are then nearly the same, or equally random. The points of a node have similar normals
 * (coordinator/integrate/patches/link_tree.h), so that light does not leak through the backs of lit surfaces.
 *
 * F is the mean over the node to the second order in its size, by the covariance of its points' places, if the whole
 * node lies above the point's horizon and faces the point. Else F and B are those of k, as if the node's whole area
 * were there, without M: correct in the mean over k. A link to a single point has the factor of the patches pass.
 *
 * Opening. R is the node's radius, r its distance, rho = R / r. L and S are the mean and the standard deviation of its
 * points' first light (direct or emitted light), l is the mean of first light over all points, T = L + l. The variance
 * of a link is estimated as F^2 (v T^2 + (8 rho S)^2), with v = KILN_LINKS_UNSEEN, for visibility by one ray, plus 4
 * (rho bend)^2, for normals that differ; v = 1 if F is that of k. The 8 was found by trial: a few bright points in a
 * node cause most of the error. The link is used if the variance is at most e^2 l T F, with e the requested error, and
 * r >= 1.5 R; else the node's children are tried. So the variances of a point's links add up to e^2 times the square of
 * its light, or of l, if l is more: l stands for a point's light before it is gathered. Nodes whose F is below 1e-3 e^2
 * are left out, as are those that lie behind the point or look away.
 *
 * Rows are closed as those of the patches pass, by rays of one stream (the parameters'), kiln_links_samples of them.
 *
 * Error. The squared error of a point's links is estimated as the sum of F^2 (q (B^2 + S^2) + (1.5 rho S)^2), with B^2
 * + S^2 instead of the last term if F is that of k; here S is of the gathered light. q is the variance of V: half of
 * the mean squared difference between neighbouring squares of points with rays of their own, and a little more. The
 * error is scaled with the row's closing factor, but by at most KILN_LINKS_CLOSED_MOST, or until it equals the light:
 * large closing factors come from occluded links; were these visible, the factor would be small. All bounces use the
 * same links, so their errors add up, not their squares: the error is that of the light of all bounces so far, and each
 * bounce reports its increase of the square.
 *
 * Target. The error of first light, as root mean square over a tile's points, is compared with the target times that
 * light, or times KILN_LINKS_LEAST_LIGHT l if more. While it is larger, links are found again with half the e, until e
 * is below the target over KILN_LINKS_BELOW_TARGET: then e is no longer the cause, but visibility by one ray a texel.
 * Kept links are checked, too, as they may have been found for other light. The least light is low, because points that
 * are dark in the first bounce may get light in later ones by the same links. If the target is less than e, it decides
 * the number of rays that close rows; rows of kept links are closed again.
 *
 * The links of a tile run are kept: the nodes, and for each node the points that see it. A later bounce then only adds
 * up. Each point's sum follows the order of the tree, so the bits are the same for kept links, links found again, and
 * any division into tile runs.
 *
 * Items: tile runs. Result: struct kiln_point_result, with its error. Samples: rays that measure the shares. Rays:
 * where links are found the samples of all valid points, and those of V; else none. For devices, the host traverses the
 * tree and checks the target. */
#ifndef KILN_WORKER_PASS_LINKS_H
#define KILN_WORKER_PASS_LINKS_H

#include "worker/pass/patches.h"
#include "worker/scene/surface.h"

#define KILN_LINKS_UNSEEN 0.03
#define KILN_LINKS_LEAST_LIGHT 0.005
#define KILN_LINKS_BELOW_TARGET 8.0
#define KILN_LINKS_CLOSED_MOST 2.0

/* Target of a link: a node, by its number, or with KILN_LINK_LEAF a single point, by its place in the tree's order. */
#define KILN_LINK_LEAF 0x80000000u
enum { KILN_LINK_CHILDREN = 4, KILN_LINKS_MOST_OPENED = 31 };

/* A node of the tree; lengths in m, places from the scene's centre. Children have higher numbers than their parents.
 * Node 0 is the root. */
struct kiln_link_node {
    uint32_t child[KILN_LINK_CHILDREN]; /* links' numbers */
    uint32_t children;
    uint32_t first, count;   /* its points: places in the tree's order */
    struct kiln_vec3 centre; /* mean of the places, by area */
    struct kiln_vec3 normal; /* likewise of the normals: shorter than 1 where they differ */
    float radius;            /* about the centre, of a ball that holds all */
    float height;            /* how far places lie off the plane through the centre with that normal, at most */
    float bend;              /* largest length of the difference of a point's normal from `normal` */
    float area, most_area;   /* m2, of all points and of the largest */
    float covariance[6];     /* m2, of all points' surface: xx, yy, zz, xy, xz, yz */
    float level, spread;     /* first light: mean, standard deviation, over the mean of all points */
};

/* Data of a point for which links have been found. */
struct kiln_linked_point {
    float scale;                      /* of its row */
    float escaped, blocked, glass[3]; /* as in struct kiln_point_result, for `count` samples */
    float present;                    /* likewise */
    uint32_t count;                   /* 0: it has no light */
};

/* A link of one point through tinted or partly transparent surfaces. */
struct kiln_tinted_link {
    uint32_t to, bit; /* of the point, in the tile */
    float through[3];
};

/* The links of a tile run, as they are worked with. Points are bits of the tile. Zero: empty; release with
 * kiln_found_links_release. */
struct kiln_found_links {
    uint32_t count, tinted_count;
    uint32_t opened;        /* number of times e was halved; at most KILN_LINKS_MOST_OPENED */
    uint32_t *to;           /* `count`, in the order of the tree */
    uint64_t *asked, *seen; /* `count` masks: points that have the link; those of them that see its target */
    struct kiln_tinted_link *tinted;
    struct kiln_linked_point point[KILN_TILE_TEXELS];
    float shading[KILN_TILE_TEXELS][3]; /* if smooth: their shading normals; else these are the geometric ones */
    bool smooth;
    size_t room_to, room_asked, room_seen, room_tinted;
};

/* Links of a tile run in compact form, as kept in memory and in files. One allocation, owned by its keeper, freed by
 * free(). Each link takes two or three bytes, and masks only if some points do not have the link or do not see its
 * target: worker/pass/links.c. */
struct kiln_kept_links {
    uint64_t first;     /* global index of the tile run's first point */
    uint32_t points;    /* of the tile run */
    uint32_t bytes;     /* of the code */
    uint32_t links;     /* number of links of points that bring light */
    uint16_t of_file;   /* 1: read from a file that another bake kept */
    uint16_t is_judged; /* 1: links were already refined to the target */
    uint8_t code[];
};

/* Limit, in radii of a node, for two or four of a point's edges: below it points share a ray. */
double kiln_links_shared(double error);
/* Number of rays that measure how much of a point's light escapes or is blocked: enough for the error, at most
 * `samples`. */
uint32_t kiln_links_samples(double error, uint32_t samples);

void kiln_found_links_release(struct kiln_found_links *found);
/* Makes room for `count` links. KILN_SYSTEM. */
int kiln_found_links_reserve(struct kiln_found_links *found, size_t count, struct kiln_error *error);
int kiln_found_links_reserve_tinted(struct kiln_found_links *found, size_t count, struct kiln_error *error);

/* Encodes links in compact form. `mask`: the tile run's points; `shares`: points of the tile that send light, which ask
 * for links, too. KILN_SYSTEM. */
int kiln_links_encode(struct kiln_kept_links **kept, const struct kiln_found_links *found, uint64_t first,
                      uint64_t mask, uint64_t shares, struct kiln_error *error);
/* Decodes links from compact form. KILN_BAD_INPUT: the code is damaged, or links go to nodes or points that do not
 * exist. KILN_SYSTEM. */
int kiln_links_decode(struct kiln_found_links *found, const struct kiln_kept_links *kept, uint64_t mask,
                      uint64_t shares, uint32_t node_count, uint64_t point_count, struct kiln_error *error);
/* Checks an untrusted code without the tree. KILN_BAD_INPUT: damaged, links beyond `point_count` points, or a number
 * that is not finite or that no bake produces. */
int kiln_links_check(const struct kiln_kept_links *kept, uint64_t point_count, struct kiln_error *error);
/* Number of times that e was halved for the links. */
uint32_t kiln_links_opened(const struct kiln_kept_links *kept);
/* Replaces *kept by `made`, and frees the former. If both have the same links, and only the closing of rows differs,
 * `of_file` is kept. */
void kiln_links_replace(struct kiln_kept_links **kept, struct kiln_kept_links *made);
/* Counts the links of a tile run, and its tinted links. KILN_BAD_INPUT: as above. */
int kiln_links_head(const struct kiln_kept_links *kept, uint32_t *count, uint32_t *tinted, struct kiln_error *error);
/* Reads the data of the points in `mask`, stored by bit. KILN_BAD_INPUT: as above. */
int kiln_links_points(const struct kiln_kept_links *kept, uint64_t mask,
                      struct kiln_linked_point point[KILN_TILE_TEXELS], struct kiln_error *error);
/* Writes the scales of rows for the points in `mask`, by bit; and their shading normals, if the code has room for them.
 */
void kiln_links_close(struct kiln_kept_links *kept, uint64_t mask, const float scale[KILN_TILE_TEXELS],
                      const float shading[KILN_TILE_TEXELS][3]);
/* Bytes that it takes in memory. */
uint64_t kiln_links_bytes(const struct kiln_kept_links *kept);

/* Luminance that a node has sent, W/m2, up to and with this bounce (now) and without it (before): means over its
 * points, and squared standard deviations. */
struct kiln_link_light {
    float now, before, spread_now, spread_before;
};

/* Light that a node sends in this bounce; a cache line. */
struct kiln_link_sent {
    float radiosity[3]; /* W/m2, mean by area */
    float moment[3][3]; /* W/m, of each colour: the mean of the radiosity times the place, off the node's centre */
    struct kiln_link_light light;
};

/* A point that sends light, and its light in this bounce. One cache line, since points are read in no order. */
struct kiln_link_leaf {
    struct kiln_vec3 place, centre, normal; /* this, `area`, `number`: as in struct kiln_patch */
    float area;
    uint32_t number;
    float radiosity[3]; /* W/m2 */
    float now, before;  /* as in struct kiln_link_light */
};

struct kiln_links_parameters {
    const struct kiln_patch *points;     /* of all surface points, by global index; borrowed, as all here */
    const uint32_t *order;               /* global indices of the points in the tree */
    const struct kiln_link_leaf *leaves; /* these points, in this order */
    uint64_t count;                      /* of these */
    const struct kiln_link_node *nodes;  /* node_count; none where no point sends light */
    uint32_t node_count;
    const struct kiln_link_sent *sent; /* of nodes */
    const uint32_t *rooms;             /* room of each surface point, by global index; different rooms share no ray */
    const float *first;                /* luminance of first light of all points, by global index, over the mean */
    double error;                      /* e, relative */
    double target;                     /* standard error of a point's light that links are opened to; 0: none */
    uint32_t stream;                   /* of the rays that measure shares */
    /* Kept links by tile run of the backend's surface: used if present, else stored here once found. NULL: links are
     * always found anew and not kept. */
    struct kiln_kept_links **kept;
};

#endif
