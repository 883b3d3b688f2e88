/* Shared functions of the Embree backend: switching the processor to the floating-point mode that Embree wants and
 * back, and reading a thread's processor time. */
#include <time.h>
#ifdef __SSE__
#    include <xmmintrin.h>
#endif

#include "worker/backend/embree/embree.h"

unsigned embree_enter(void)
{
#ifdef __SSE__
    const unsigned saved = _mm_getcsr();
    _mm_setcsr(saved | 0x8040u); /* flush to zero, denormals are zero */
    return saved;
#else
    return 0;
#endif
}

void embree_leave(unsigned saved)
{
#ifdef __SSE__
    _mm_setcsr(saved);
#else
    (void)saved;
#endif
}

double embree_thread_seconds(void)
{
    struct timespec t;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}
