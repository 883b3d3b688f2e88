/* The links pass: the light of the patches pass (worker/pass/patches.h), gathered from nodes of a tree over all surface
 * points, of which each point takes such as are good enough for it (Hanrahan, Salzman and Aupperle, "A Rapid
 * Hierarchical Radiosity Algorithm", SIGGRAPH 1991; Smits, Arvo and Greenberg, "A Clustering Algorithm for Radiosity in
 * Complex Environments", SIGGRAPH 1994; Kahl's tiles, 2023, end where a window ends).
 *
 *     E(i) = sum over links (i, j) of  (B(j) F(i, j) + M(j) . grad F(i, j)) V(i, k(i, j))
 *
 * B is the mean radiosity of the node, by area, and M the mean of its radiosity times the place off its centre: so the
 * sum is that of what its parts send, to the first order. What is nearer is brighter, or darker, than the mean; without
 * M light was 1 to 3 % low. No link's light falls below 0. V is what the surfaces
 * between the point and one of the node's points let through, k: taken by a sequence that goes from point to point
 * through all that the node has, so that the means over a tile's points are right. A square of 2 x 2 or 4 x 4 points of
 * a tile that are in one room has one V by one ray where two or four of a point's edges are less than kiln_links_shared
 * times R: then they see the node as one, or what they see of it is as much of a chance for each of them. A node's
 * points look much the same way (coordinator/integrate/patches/link_tree.h), so that the back of what is lit never
 * shines through.
 *
 * F is the mean over the node to the second order in its size, by the covariance of its points' places, where it lies
 * above the point's horizon and all of it faces the point; else F and B are those of k, as if all of the node's area
 * were there, and no M, which is right in the mean over k. A link to a single point has the factor of the
 * patches pass.
 *
 * Opening. With R the node's radius, r its distance, rho = R / r, L and S the mean and the standard deviation of its
 * points' first light (of direct light, or of what is emitted), T = L plus the mean l of all points' first light: a
 * link's variance is taken for F^2 (v T^2 + (8 rho S)^2), v = KILN_LINKS_UNSEEN for what one ray knows of the view and
 * 4 (rho bend)^2 for normals that differ, or 1 where F is that of k. The 8 is found by trial: a few bright points in a
 * node are what costs most. It stands where that is at most e^2 l T F, e the error asked for, and r >= 1.5 R; else the
 * node's children are asked. So the variances of a point's links add up to e^2 times the square of its light, or of l
 * where that is more: l is what stands for the light of a point that has not been gathered yet. Nodes whose F is below
 * 1e-3 e^2 are left out, as are those that lie behind the point or look away.
 *
 * Rows are closed as those of the patches pass, by rays of one stream (the parameters'), kiln_links_samples of them.
 *
 * Error. What a point's links are off by, squared, is taken for the sum of F^2 (q (B^2 + S^2) + (1.5 rho S)^2), B^2 +
 * S^2 in the place of the last where F is that of k, S now of the light that is gathered. q is the variance of V, half
 * of the mean square by which the squares of points beside it differ that have rays of their own, and a little more.
 * Closed as the row is, but by no more than KILN_LINKS_CLOSED_MOST, or until it is as much as the light: what closes a
 * row by far is that links are not seen, and if they were it would not be.
 * Bounces go by the same links, so their errors add up, not their squares: light is that of all bounces so far, and the
 * bounce states what it adds to the square.
 *
 * Target. Where the error of first light, in the root of the mean square over a tile's points, is above the target
 * times that light, and KILN_LINKS_LEAST_LIGHT times l at least, links are found anew with half the e, until it is not,
 * or e is as small as the target over KILN_LINKS_BELOW_TARGET: by itself e would do then, and what is left is what one
 * ray for a texel does not know of the view. Also where they were kept, and were good for other light. That least light
 * is little: what is dark in the first bounce may have its light in the next ones, by the same links. Rows are closed
 * with as many rays as the target asks for, if it is less than e; those of kept links anew.
 *
 * What has been found for a tile run is kept: which nodes, and of each the points that see it. Then a bounce is sums.
 * Each point's sums are added in the order of the tree: kept or found again, and of any tile runs, they have the same
 * bits.
 *
 * Items: tile runs. Result: struct kiln_point_result, with its error. Samples: rays that measure the shares. Rays:
 * where links are found the samples of all valid points, and those of V; else none. On devices the tree is gone down,
 * and a target looked after, by the host. */
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

/* m, from the scene's centre; children have higher numbers than their parents. Node 0 is the root. */
struct kiln_link_node {
    uint32_t child[KILN_LINK_CHILDREN]; /* links' numbers */
    uint32_t children;
    uint32_t first, count;   /* its points: places in the tree's order */
    struct kiln_vec3 centre; /* mean of the places, by area */
    struct kiln_vec3 normal; /* likewise of the normals: shorter than 1 where they differ */
    float radius;            /* about the centre, of a ball that holds all */
    float height;            /* how far places lie off the plane through the centre with that normal, at most */
    float bend;              /* how far a normal is from `normal`, at most: a length */
    float area, most_area;   /* m2, of all points and of the largest */
    float covariance[6];     /* m2, of all points' surface: xx, yy, zz, xy, xz, yz */
    float level, spread;     /* of first light: mean and standard deviation by area, over the mean of all points */
};

/* Data of a point for which links have been found. */
struct kiln_linked_point {
    float scale;                      /* of its row */
    float escaped, blocked, glass[3]; /* as in struct kiln_point_result, for `count` samples */
    float present;                    /* likewise */
    uint32_t count;                   /* 0: it has no light */
};

/* A link of one point through what has a colour, or lets a part through. */
struct kiln_tinted_link {
    uint32_t to, bit; /* of the point, in the tile */
    float through[3];
};

/* The links of a tile run, as they are worked with. Points are bits of the tile. Zero: empty; release with
 * kiln_found_links_release. */
struct kiln_found_links {
    uint32_t count, tinted_count;
    uint32_t opened;        /* how many times e was halved for them: KILN_LINKS_MOST_OPENED at most */
    uint32_t *to;           /* `count`, in the order of the tree */
    uint64_t *asked, *seen; /* `count` masks: whose links they are; which of these see what the links go to */
    struct kiln_tinted_link *tinted;
    struct kiln_linked_point point[KILN_TILE_TEXELS];
    float shading[KILN_TILE_TEXELS][3]; /* if smooth: their shading normals; else these are the geometric ones */
    bool smooth;
    size_t room_to, room_asked, room_seen, room_tinted;
};

/* The same as it is kept, in memory and in files: owned by whoever keeps it, one block for free(). Per link of the
 * tile two or three bytes, and masks only where not all have asked or not all see: worker/pass/links.c. */
struct kiln_kept_links {
    uint64_t first;     /* global index of the tile run's first point */
    uint32_t points;    /* of the tile run */
    uint32_t bytes;     /* of the code */
    uint32_t links;     /* of points, that bring light */
    uint16_t of_file;   /* 1: as a file has it that another bake has kept */
    uint16_t is_judged; /* 1: its links have been opened as far as the target asks */
    uint8_t code[];
};

/* Radii of a node, which two or four of a point's edges are less than where points share a ray. */
double kiln_links_shared(double error);
/* Number of rays that measure a point's shares: as many as the error asks for, and no more than `samples`. */
uint32_t kiln_links_samples(double error, uint32_t samples);

void kiln_found_links_release(struct kiln_found_links *found);
/* Room for so many links. KILN_SYSTEM. */
int kiln_found_links_reserve(struct kiln_found_links *found, size_t count, struct kiln_error *error);
int kiln_found_links_reserve_tinted(struct kiln_found_links *found, size_t count, struct kiln_error *error);

/* `mask`: of the tile run's points; `shares`: of the tile's points that send light, who ask besides. KILN_SYSTEM. */
int kiln_links_encode(struct kiln_kept_links **kept, const struct kiln_found_links *found, uint64_t first,
                      uint64_t mask, uint64_t shares, struct kiln_error *error);
/* KILN_BAD_INPUT: this is no such code, or links to nodes or points that are not there. KILN_SYSTEM. */
int kiln_links_decode(struct kiln_found_links *found, const struct kiln_kept_links *kept, uint64_t mask,
                      uint64_t shares, uint32_t node_count, uint64_t point_count, struct kiln_error *error);
/* Checks a code that somebody may have made: KILN_BAD_INPUT as above, with links to `point_count` points, or if it has
 * a number that is not finite or that no bake finds. Knows nothing of the tree. */
int kiln_links_check(const struct kiln_kept_links *kept, uint64_t point_count, struct kiln_error *error);
/* Number of times that e was halved for the links. */
uint32_t kiln_links_opened(const struct kiln_kept_links *kept);
/* Puts `made` in the place of *kept, which is freed. Where these are the same links, and rows alone are closed anew,
 * they stay as of a file. */
void kiln_links_replace(struct kiln_kept_links **kept, struct kiln_kept_links *made);
/* Counts the links of the tile run, and those through what has a colour. KILN_BAD_INPUT: as above. */
int kiln_links_head(const struct kiln_kept_links *kept, uint32_t *count, uint32_t *tinted, struct kiln_error *error);
/* Reads what is known of the points of `mask`, by bit. KILN_BAD_INPUT: as above. */
int kiln_links_points(const struct kiln_kept_links *kept, uint64_t mask,
                      struct kiln_linked_point point[KILN_TILE_TEXELS], struct kiln_error *error);
/* Writes scales of rows, and where there is room for them shading normals, of the points of `mask`, by bit. */
void kiln_links_close(struct kiln_kept_links *kept, uint64_t mask, const float scale[KILN_TILE_TEXELS],
                      const float shading[KILN_TILE_TEXELS][3]);
/* Bytes that it takes in memory. */
uint64_t kiln_links_bytes(const struct kiln_kept_links *kept);

/* Luminance of what a node has sent in this bounce and those before it, and in those before it alone, W/m2: means, and
 * squares of the standard deviations. */
struct kiln_link_light {
    float now, before, spread_now, spread_before;
};

/* Light that a node sends in this bounce; a cache line. */
struct kiln_link_sent {
    float radiosity[3]; /* W/m2, mean by area */
    float moment[3][3]; /* W/m, of each colour: the mean of the radiosity times the place, off the node's centre */
    struct kiln_link_light light;
};

/* A point that sends light, and what it sends in this bounce; a cache line, for those that are asked for lie far apart.
 */
struct kiln_link_leaf {
    struct kiln_vec3 place, centre, normal; /* as in struct kiln_patch, as are the next two */
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
    const uint32_t *rooms;             /* of all surface points, by global index: those of several never share a ray */
    const float *first;                /* luminance of first light of all points, by global index, over the mean */
    double error;                      /* e, relative */
    double target;                     /* standard error of a point's light that links are opened to; 0: none */
    uint32_t stream;                   /* of the rays that measure shares */
    /* By tile run of the backend's surface: what is there is taken, and what is found is put there. NULL: found anew,
     * and not kept. */
    struct kiln_kept_links **kept;
};

#endif
