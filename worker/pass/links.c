#include "worker/pass/links.h"

#include "worker/base/memory.h"

void kiln_links_release(struct kiln_kept_links **links)
{
    struct kiln_kept_links *l = *links;
    if (l == NULL)
        return;
    kiln_free(&l->to);
    kiln_free(&l->seen);
    kiln_free(&l->tinted);
    kiln_free(&l->point);
    kiln_free(&l->shading);
    kiln_free(links);
}

uint64_t kiln_links_bytes(const struct kiln_kept_links *l)
{
    return sizeof *l + (uint64_t)l->count * (sizeof *l->to + sizeof *l->seen) +
           (uint64_t)l->tinted_count * sizeof *l->tinted +
           (uint64_t)l->points * (sizeof *l->point + (l->shading != NULL ? sizeof *l->shading : 0));
}
