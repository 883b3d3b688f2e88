/* Joining two clusters to one. */

/* Which of two neighbours is nearer: by the area of the box around both; of equal ones the lower key, which both ends
 * of a pair share, and of which no two neighbours of one cluster have the same. So the nearest pair of all is always
 * joined, and of many equal boxes half are (the keys of places 2 k and 2 k + 1 are 1). */
bool bvh_is_nearer(float area, uint key, float than_area, uint than_key)
{
    return area < than_area || (area == than_area && key < than_key);
}

/* What is below two joined nodes: a leaf where that costs no more (surface area heuristic: a node and a triangle cost
 * the same). */
kiln_gpu_bvh_share bvh_share_of(const kiln_gpu_bvh_share a, const kiln_gpu_bvh_share b, float area)
{
    const uint triangles = (a.triangles & ~KILN_GPU_LEAF) + (b.triangles & ~KILN_GPU_LEAF);
    const float apart = area + a.cost + b.cost, together = area * float(triangles);
    const bool leaf = triangles <= KILN_BVH_LEAF && together <= apart;
    return kiln_gpu_bvh_share(leaf ? KILN_GPU_LEAF | triangles : triangles, leaf ? together : apart);
}

void bvh_write_node(uint at, const bvh_box box, uint first, uint second)
{
    BvhNodes(BVH.nodes + 32ul * at).at[0] = kiln_gpu_bvh_node(float[3](box.lower.x, box.lower.y, box.lower.z), first,
                                                              float[3](box.upper.x, box.upper.y, box.upper.z), second);
}
