/* Joining two clusters to one. */

/* Which of two neighbours is nearer: by the area of the box around both; of equal ones the lower key, which both ends
 * of a pair share, and of which no two neighbours of one cluster have the same. So the nearest pair of all is always
 * joined, and of many equal boxes half are (the keys of places 2 k and 2 k + 1 are 1). */
bool bvh_is_nearer(float area, uint key, float than_area, uint than_key)
{
    return area < than_area || (area == than_area && key < than_key);
}

/* What is below two joined nodes, at least cost (Ylitie et al. 2017, equations 2 to 5): a leaf where that costs no more
 * than a node of four. A node and a triangle cost the same. */
kiln_gpu_bvh_share bvh_share_of(const kiln_gpu_bvh_share a, const kiln_gpu_bvh_share b, float area)
{
    const uint triangles = (a.triangles & ~KILN_GPU_LEAF) + (b.triangles & ~KILN_GPU_LEAF);
    uint first;
    const float apart = area + bvh_distribute(a.cost, b.cost, 4u, first), together = area * float(triangles);
    const bool leaf = triangles <= KILN_BVH_LEAF && together <= apart;
    const float one = leaf ? together : apart, two = min(one, bvh_distribute(a.cost, b.cost, 2u, first));
    const float three = min(two, bvh_distribute(a.cost, b.cost, 3u, first));
    return kiln_gpu_bvh_share(leaf ? KILN_GPU_LEAF | triangles : triangles, float[3](one, two, three));
}

void bvh_write_node(uint at, const bvh_box box, uint first, uint second)
{
    BvhNodes(BVH.nodes + 32ul * at).at[0] = kiln_gpu_bvh_node(float[3](box.lower.x, box.lower.y, box.lower.z), first,
                                                              float[3](box.upper.x, box.upper.y, box.upper.z), second);
}
