#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "where.h"
#ifdef WARP
#define VISIT(n) w->visits[n]++;
#else
#define VISIT(n)
#endif
#define B2F(x) ({ uint32_t v_ = (x); float f_; memcpy(&f_, &v_, 4); f_; })
#define B2D(x) ({ uint64_t v_ = (x); double f_; memcpy(&f_, &v_, 8); f_; })
#define F2B(x) ({ float v_ = (x); uint32_t f_; memcpy(&f_, &v_, 4); f_; })
#define D2B(x) ({ double v_ = (x); uint64_t f_; memcpy(&f_, &v_, 8); f_; })
#ifdef TOUCH  // kind: 0 load, 1 store, 2 atomic; 4 more of shared memory
#define LD(T, a, s) (*({ uint64_t p_ = (uint64_t)(a); w->touch(w, p_, sizeof(T), s); (volatile T *)p_; }))
#define ST(T, a, s) (*({ uint64_t p_ = (uint64_t)(a); w->touch(w, p_, sizeof(T), s + 1); (volatile T *)p_; }))
#define AT(p, s) ({ __typeof__(p) q_ = (p); w->touch(w, (uint64_t)q_, sizeof(*q_), s + 2); q_; })
#else
#define LD(T, a, s) (*(volatile T *)(uint64_t)(a))
#define ST(T, a, s) LD(T, a, s)
#define AT(p, s) p
#endif
// A whole number as an integer from -top or 0 to top - 1, or the nearest of these.
static int64_t d2s(double x, double top, int64_t nan) { return isnan(x) ? nan : x <= -top ? (int64_t)-top : x < top ? (int64_t)x : top > 9e18 ? INT64_MAX : (int64_t)top - 1; }
static uint64_t d2u(double x, double top, uint64_t nan) { return isnan(x) ? nan : x <= 0 ? 0 : x < top ? (uint64_t)x : top > 1e19 ? UINT64_MAX : (uint64_t)top - 1; }
static void F_vprintf(void *ret, void **a, Where *w) { fprintf(stderr, "vprintf: %s\n", *(char **)a[0]); *(int *)ret = 0; }
static void F___assertfail(void *ret, void **a, Where *w) { fprintf(stderr, "assertfail: %s\n", *(char **)a[0]); abort(); }
static void F_malloc(void *ret, void **a, Where *w) { *(void **)ret = malloc(*(uint64_t *)a[0]); }
static void F_free(void *ret, void **a, Where *w) { free(*(void **)a[0]); }
typedef void (*FP)(void *, void **, Where *);
