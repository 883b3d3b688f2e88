#include "worker/light/view_factor.h"

#include "shaders/shared/view_factor.h"

double kiln_view_factor_near(const struct kiln_parallelogram *p, struct kiln_dvec3 n, struct kiln_dvec3 about)
{
    return kiln_view_factor(p->centre, p->edge_s, p->edge_t, n, about);
}
