// A stand-in for libcuda.so: device memory is host memory; modules are dumped as PTX; launches are logged, or run on
// the CPU by code that ptx2c.py made of the PTX (STUB_EMU=1).
// Environment: STUB_DIR (dumps, log, cache), STUB_EMU, STUB_SM (multiprocessors), STUB_BLOCKS (blocks per SM),
// STUB_ORDER (0 ascending, 1 descending, n>1: shuffled with seed n), STUB_THREADS (pthreads that share the blocks)
// Threads that meet at barriers, shuffles or votes run as fibers, one stack each, block after block.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <malloc.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#define STACK (512u << 10)
#include "where.h"
typedef void (*Fn)(void **, Where *);
typedef struct { int id; void *so; char dir[512]; } Module;
typedef struct { Module *m; char name[512]; Fn fn; int meets, blocks; void (*poison)(void); const uint16_t (*classes)[11], *cycles, *overlapped; } Func;
static FILE *logf_;
static const char *dir(void) { const char *d = getenv("STUB_DIR"); return d ? d : "."; }
static long geti(const char *n, long d) { const char *v = getenv(n); return v ? atol(v) : d; }
static FILE *lg(void) {
  if (!logf_) { char p[600]; snprintf(p, 600, "%s/launch.log", dir()); mkdir(dir(), 0755); logf_ = fopen(p, "w"); setvbuf(logf_, 0, _IOFBF, 1 << 20); }
  return logf_;
}
static long n_launch, n_h2d, n_d2h, n_sync, n_alloc, n_free, n_memset, n_d2d, n_getfn;
static size_t b_h2d, b_d2h, b_set;
__attribute__((destructor)) static void bye(void) {
  fprintf(lg(), "TOTAL launches %ld h2d %ld (%zu B) d2h %ld (%zu B) sync %ld alloc %ld free %ld memset %ld (%zu B) d2d %ld getfn %ld\n",
          n_launch, n_h2d, b_h2d, n_d2h, b_d2h, n_sync, n_alloc, n_free, n_memset, b_set, n_d2d, n_getfn);
  fflush(lg());
}
void stub_counts(long *out) { long c[11] = {n_launch, n_h2d, b_h2d, n_d2h, b_d2h, n_sync, n_alloc, n_free, n_memset, b_set, n_getfn}; memcpy(out, c, sizeof c); }
int cuInit(unsigned f) { return 0; }
int cuDriverGetVersion(int *v) { *v = 13000; return 0; }
int cuDeviceGetCount(int *n) { *n = 1; return 0; }
int cuDeviceGet(int *d, int i) { *d = 0; return 0; }
int cuDeviceGetName(char *s, int n, int d) { snprintf(s, n, "NVIDIA H200 (stub)"); return 0; }
int cuDeviceGetAttribute(int *v, int a, int d) {
  switch (a) {
    case 75: *v = 9; break;  // cc major
    case 76: *v = 0; break;
    case 16: *v = geti("STUB_SM", 132); break;
    case 2: *v = 1024; break;   // max block dim x
    case 1: *v = 1024; break;
    case 106: *v = geti("STUB_BLOCKS", 32); break;  // max blocks per SM
    case 97: *v = 232448; break;  // shared optin
    case 115: *v = 1; break;  // mem pools
    default: *v = 0; fprintf(lg(), "ATTR %d\n", a);
  }
  return 0;
}
int cuDeviceGetDefaultMemPool(void **p, int d) { *p = (void *)1; return 0; }
int cuMemPoolSetAttribute(void *p, int a, void *v) { return 0; }
int cuCtxCreate_v2(void **c, unsigned f, int d) { *c = (void *)1; return 0; }
int cuCtxSetCurrent(void *c) { return 0; }
int cuCtxGetCurrent(void **c) { *c = (void *)1; return 0; }
int cuDevicePrimaryCtxRetain(void **c, int d) { *c = (void *)1; return 0; }
int cuCtxSetLimit(int l, size_t v) { return 0; }
int cuStreamCreate(void **s, unsigned f) { *s = (void *)1; return 0; }
int cuStreamSynchronize(void *s) { n_sync++; return 0; }
int cuCtxSynchronize(void) { n_sync++; return 0; }
int cuStreamDestroy_v2(void *s) { return 0; }
int cuStreamWaitEvent(void *s, void *e, unsigned f) { return 0; }
static int mal(void **p, size_t n) { n_alloc++; *p = 0; if (posix_memalign(p, 4096, n ? n : 1)) return 2; if (getenv("STUB_POISON")) memset(*p, 0xA5, n); return 0; }
static void *mine[256]; static size_t mine_n[256]; static int n_mine;
int cuMemAlloc_v2(void **p, size_t n) { int e = mal(p, n); if (n_mine < 256) { mine_n[n_mine] = n; mine[n_mine++] = *p; } return e; }
int cuMemAllocAsync(void **p, size_t n, void *s) { return mal(p, n); }
int cuMemAllocManaged(void **p, size_t n, unsigned f) { return mal(p, n); }
int cuMemAllocHost_v2(void **p, size_t n) { return mal(p, n); }
int cuMemFreeHost(void *p) { free(p); return 0; }
int cuMemPoolTrimTo(void *pool, size_t n) { return 0; }
int cuMemFree_v2(void *p) { n_free++; free(p); return 0; }
int cuMemFreeAsync(void *p, void *s) { n_free++; free(p); return 0; }
int cuMemcpyHtoD_v2(void *d, void *s, size_t n) { n_h2d++; b_h2d += n; memcpy(d, s, n); return 0; }
int cuMemcpyDtoH_v2(void *d, void *s, size_t n) { n_d2h++; b_d2h += n; memcpy(d, s, n); return 0; }
int cuMemcpyDtoD_v2(void *d, void *s, size_t n) { n_d2d++; memmove(d, s, n); return 0; }
int cuMemcpyHtoDAsync_v2(void *d, void *s, size_t n, void *st) { n_h2d++; b_h2d += n; memcpy(d, s, n); return 0; }
int cuMemcpyDtoHAsync_v2(void *d, void *s, size_t n, void *st) { n_d2h++; b_d2h += n; memcpy(d, s, n); return 0; }
int cuMemsetD8_v2(void *d, unsigned char v, size_t n) { n_memset++; b_set += n; memset(d, v, n); return 0; }
int cuMemsetD32_v2(void *d, uint32_t v, size_t n) { n_memset++; uint32_t *q = d; for (size_t i = 0; i < n; i++) q[i] = v; return 0; }
int cuMemAdvise(void *p, size_t n, unsigned a, int d) { return 0; }
int cuMemGetInfo_v2(size_t *f, size_t *t) { *f = 139ul << 30; *t = 140ul << 30; return 0; }
int cuDeviceTotalMem_v2(size_t *n, int d) { *n = 70000000000ul; return 0; }
int cuPointerGetAttribute(unsigned *v, int a, void *p) { for (int i = 0; i < n_mine; i++) if ((char *)p >= (char *)mine[i] && (char *)p < (char *)mine[i] + mine_n[i]) { *v = 2; return 0; } return 1; }
int cuFuncGetAttribute(int *v, int a, void *f) { *v = 0; return 0; }
int cuFuncSetAttribute(void *f, int a, int v) { fprintf(lg(), "FUNCSET %d %d\n", a, v); return 0; }
int cuOccupancyMaxActiveBlocksPerMultiprocessor(int *n, void *f, int b, size_t s) { *n = 16; return 0; }
int cuEventCreate(void **e, unsigned f) { *e = malloc(16); return 0; }
int cuEventDestroy(void *e) { free(e); return 0; }
int cuEventRecord(void *e, void *s) { clock_gettime(CLOCK_MONOTONIC, e); return 0; }
int cuEventSynchronize(void *e) { return 0; }
int cuEventElapsedTime(float *ms, void *a, void *b) { struct timespec *x = a, *y = b; *ms = (y->tv_sec - x->tv_sec) * 1e3 + (y->tv_nsec - x->tv_nsec) * 1e-6; return 0; }
int cuGetErrorName(int e, const char **s) { *s = "STUB_ERROR"; return 0; }
int cuGetErrorString(int e, const char **s) { *s = "stub error"; return 0; }
#define NO(f) int f(void) { fprintf(stderr, #f " called\n"); return 801; }
NO(cuImportExternalMemory) NO(cuExternalMemoryGetMappedBuffer) NO(cuExternalMemoryGetMappedMipmappedArray)
NO(cuMipmappedArrayGetLevel) NO(cuSurfObjectCreate) NO(cuSignalExternalSemaphoresAsync) NO(cuWaitExternalSemaphoresAsync)
NO(cuImportExternalSemaphore)
// counting (STUB_COUNT): accesses, bytes asked for, and distinct 32-byte sectors of each launch, by kernel
typedef struct { char name[256]; long launches, access, bytes, sectors; } Count;
static Count counts[2048]; static int n_counts; static Count *now_c; static uint32_t *tags, tag_now;
static void count_touch(Where *w, uint64_t a, int n, int kind) {
  char here; if (kind & 4 || (a > (uint64_t)&here - 4096 && a < (uint64_t)&here + STACK)) return;  // shared memory, its own stack
  now_c->access++; now_c->bytes += n;
  uint64_t s = a >> 5; uint32_t h = (uint32_t)((s * 11400714819323198485ull) >> 36);
  if (tags[h] != tag_now) { tags[h] = tag_now; now_c->sectors++; }
}
static int by_sec(const void *a, const void *b) { return strcmp(((Count *)a)->name, ((Count *)b)->name); }
__attribute__((destructor)) static void tell_counts(void) {
  if (!tags) return; char p[600]; snprintf(p, 600, "%s/counts.txt", dir()); FILE *f = fopen(p, "w");
  qsort(counts, n_counts, sizeof(Count), by_sec);
  for (int i = 0; i < n_counts; i++) fprintf(f, "%s %ld %ld %ld %ld\n", counts[i].name, counts[i].launches, counts[i].access, counts[i].bytes, counts[i].sectors);
  fclose(f);
}
static int n_modules;
// quadrants looks for graphs and a linker; kernels of this program use neither: 801 is CUDA_ERROR_NOT_SUPPORTED.
#define NOT_HERE(name) int name(void) { return 801; }
NOT_HERE(cuGraphAddEmptyNode)
NOT_HERE(cuGraphAddKernelNode)
NOT_HERE(cuGraphAddNode)
NOT_HERE(cuGraphConditionalHandleCreate)
NOT_HERE(cuGraphCreate)
NOT_HERE(cuGraphDestroy)
NOT_HERE(cuGraphExecDestroy)
NOT_HERE(cuGraphInstantiate)
NOT_HERE(cuGraphLaunch)
NOT_HERE(cuLinkAddData_v2)
NOT_HERE(cuLinkAddFile_v2)
NOT_HERE(cuLinkComplete)
NOT_HERE(cuLinkCreate_v2)
NOT_HERE(cuLinkDestroy)
int cuModuleLoadDataEx(void **out, const char *ptx, unsigned n, int *o, void **ov) {
  Module *m = calloc(1, sizeof *m);
  m->id = n_modules++;
  uint64_t h = 1469598103934665603ull;
  size_t len = strlen(ptx);
  for (size_t i = 0; i < len; i++) h = (h ^ (unsigned char)ptx[i]) * 1099511628211ull;
  char p[600], cmd[2000];
  mkdir(dir(), 0755);
  snprintf(p, 600, "%s/m_%016lx.ptx", dir(), (unsigned long)h);
  if (access(p, F_OK)) { FILE *f = fopen(p, "w"); fwrite(ptx, 1, len, f); fclose(f); }
  fprintf(lg(), "MODULE %d %s %zu\n", m->id, p, len);
  if (geti("STUB_EMU", 0)) {
    snprintf(m->dir, 512, "%s/m_%016lx.so", dir(), (unsigned long)h);
    if (access(m->dir, F_OK)) {
      snprintf(cmd, 2000, "LD_LIBRARY_PATH= %s %s", getenv("STUB_CC") ? getenv("STUB_CC") : "false", p);
      fprintf(lg(), "CC %s\n", cmd); fflush(lg());
      if (system(cmd)) { fprintf(stderr, "stub: cannot compile %s\n", p); return 218; }
    }
    m->so = dlopen(m->dir, RTLD_NOW | RTLD_LOCAL);
    if (!m->so) { fprintf(stderr, "stub: %s\n", dlerror()); return 218; }
  }
  *out = m;
  return 0;
}
int cuModuleLoadData(void **out, const char *ptx) { return cuModuleLoadDataEx(out, ptx, 0, 0, 0); }
int cuModuleGetFunction(void **out, Module *m, const char *name) {
  n_getfn++;
  static Func *cache[4096]; static int n;
  for (int i = n - 1; i >= 0; i--) if (cache[i]->m == m && !strcmp(cache[i]->name, name)) { *out = cache[i]; return 0; }
  Func *f = calloc(1, sizeof *f);
  f->m = m; snprintf(f->name, 512, "%s", name);
  if (m->so) { char s[600]; snprintf(s, 600, "K_%s", name); f->fn = (Fn)dlsym(m->so, s); if (!f->fn) { fprintf(stderr, "stub: no %s\n", s); return 500; }
    snprintf(s, 600, "C_%s", name); f->meets = *(int *)dlsym(m->so, s); f->blocks = *(int *)dlsym(m->so, "M_blocks");
    f->poison = (void (*)(void))dlsym(m->so, "M_poison"); f->classes = dlsym(m->so, "M_classes");
    f->cycles = dlsym(m->so, "M_cycles"); f->overlapped = dlsym(m->so, "M_overlapped"); }
  if (n < 4096) cache[n++] = f;
  *out = f;
  return 0;
}
// ---------------------------------------------------------------- fibers
// Each thread of a block runs until it waits for others. bar.sync waits for all threads of the block that have not
// ended, the .sync operations of a warp for those of their mask. All must wait at the same instruction: if none can go
// on, who waits where is told, and the process aborts.
static const char *op_names[] = {"bar.sync", "bar.red.popc", "bar.red.and", "bar.red.or", "bar.warp.sync", "vote.ballot", "vote.all", "vote.any", "vote.uni",
                                 "shfl.idx", "shfl.up", "shfl.down", "shfl.bfly", "match.any", "match.all"};
enum { FRESH, RUNS, WAITS, ENDED };
typedef struct { Where w; void *sp, *stack; int state, op, site; uint32_t mask, value, arg, clamp, result; uint8_t *pred; uint32_t *visits; } Fiber;
typedef struct Block { Fiber *f; uint32_t n; Func *fn; void **args; Fiber *now; void *sp; uint32_t epoch, warp_epoch[32]; double crit_now[32], over_now[32]; } Block;
static __thread Block *block;
enum { CLASSES = 11, C_INT = 0, C_F64, C_DIV, C_LDS, C_STS, C_LDG, C_STG, C_ATOMS, C_ATOMG, C_MEET, C_BRANCH };
// Instructions of SASS that one of PTX becomes.
static const double issue_of[CLASSES] = {1, 1, 22, 1, 1, 1, 1, 1, 1, 1, 1};
static struct { char name[256]; double launches, blocks, thread[CLASSES], warp[CLASSES], crit, over; } warps[512]; static int n_warps, warp_now; static pthread_mutex_t warp_lock = PTHREAD_MUTEX_INITIALIZER;
static int counting, racing, touching;
#if defined(__x86_64__)
void stub_switch(void **from, void *to);
__asm__(".text\n.globl stub_switch\n.hidden stub_switch\nstub_switch:\n push %rbp\n push %rbx\n push %r12\n push %r13\n push %r14\n push %r15\n mov %rsp,(%rdi)\n mov %rsi,%rsp\n"
        " pop %r15\n pop %r14\n pop %r13\n pop %r12\n pop %rbx\n pop %rbp\n ret\n");
static void fiber_main(void);
static void fiber_new(Fiber *f) {
  uint64_t *top = (uint64_t *)((char *)f->stack + STACK - 72);  // as after a call: 8 beside a multiple of 16
  top[0] = 0; *--top = (uint64_t)fiber_main;
  for (int i = 0; i < 6; i++) *--top = 0;
  f->sp = top;
}
#else
#include <ucontext.h>
static void fiber_main(void);
static void stub_switch(void **from, void *to) { swapcontext((ucontext_t *)*from, (ucontext_t *)to); }
static void fiber_new(Fiber *f) {
  ucontext_t *u = f->sp ? f->sp : calloc(1, sizeof *u); getcontext(u); u->uc_stack.ss_sp = f->stack; u->uc_stack.ss_size = STACK; makecontext(u, fiber_main, 0); f->sp = u;
  if (!block->sp) block->sp = calloc(1, sizeof(ucontext_t));
}
#endif
static void to_scheduler(void) { Fiber *f = block->now; stub_switch(&f->sp, block->sp); }
static void fiber_main(void) { Fiber *f = block->now; block->fn->fn(block->args, &f->w); f->state = ENDED; to_scheduler(); abort(); }
static uint32_t meet(Where *w, int op, int site, uint32_t mask, uint32_t value, uint32_t arg, uint32_t clamp, uint8_t *pred) {
  Fiber *f = (Fiber *)w; f->state = WAITS; f->op = op; f->site = site; f->mask = mask; f->value = value; f->arg = arg; f->clamp = clamp; f->pred = pred;
  to_scheduler();
  return f->result;
}
static void fold(Block *b, uint32_t first, uint32_t mask) {  // what the lanes of a warp did since they met last
  int e; double crit = 0, over = 0;
  for (int k = 0; k < b->fn->blocks; k++) {
    uint32_t most = 0; double sum = 0;
    for (uint32_t l = 0; l < 32 && first + l < b->n; l++) if (mask >> l & 1) { uint32_t *v = &b->f[first + l].visits[k]; sum += *v; if (*v > most) most = *v; *v = 0; }
    over += (double)most * b->fn->overlapped[k];
    if (most) for (e = 0; e < CLASSES; e++) { double n = b->fn->classes[k][e]; warps[warp_now].thread[e] += n * sum; warps[warp_now].warp[e] += n * most; crit += n * most * b->fn->cycles[e]; }
  }
  b->crit_now[first / 32] += crit; b->over_now[first / 32] += over;
}
static void end_interval(Block *b) { double most = 0, over = 0;  // between two barriers of the block
  for (int k = 0; k < 32; k++) { if (b->over_now[k] > over) over = b->over_now[k]; b->over_now[k] = 0; } warps[warp_now].over += over;
  if (counting > 1) {
    static double before[512]; double issue = 0; for (int e = 0; e < CLASSES; e++) issue += warps[warp_now].warp[e] * issue_of[e];
    for (int k = 0; k < 32; k++) if (b->crit_now[k] > most) most = b->crit_now[k];
    fprintf(stderr, "interval %s block %u %u at %d: cycles %.0f overlapped %.0f warp instructions %.0f\n", b->fn->name, b->f[0].w.ctaid, b->epoch, b->f[0].site, most, over, issue - before[warp_now]);
    before[warp_now] = issue; most = 0;
  } for (int k = 0; k < 32; k++) { if (b->crit_now[k] > most) most = b->crit_now[k]; b->crit_now[k] = 0; } warps[warp_now].crit += most; }
static int complete(Block *b, Fiber *f) {  // lets those that wait with f go on, if all are there
  uint32_t t = f - b->f, first = t & ~31u, warp_n = b->n - first < 32 ? b->n - first : 32;
  if (f->op <= BAR_OR) {
    int count = 0, all = 1, any = 0;
    for (uint32_t i = 0; i < b->n; i++) if (b->f[i].state != ENDED) { if (b->f[i].state != WAITS || b->f[i].op != f->op || b->f[i].site != f->site) return 0; }
    for (uint32_t i = 0; i < b->n; i++) if (b->f[i].state != ENDED) { int v = b->f[i].value != 0; count += v; all &= v; any |= v; }
    for (uint32_t i = 0; i < b->n; i++) if (b->f[i].state != ENDED) { b->f[i].result = f->op == BAR_POPC ? count : f->op == BAR_AND ? all : any; b->f[i].state = RUNS; }
    if (counting) { for (uint32_t k = 0; k < b->n; k += 32) fold(b, k, ~0u); end_interval(b); }
    b->epoch++;
    return 1;
  }
  uint32_t there = 0;
  for (uint32_t l = 0; l < warp_n; l++) {
    Fiber *o = &b->f[first + l];
    if (!(f->mask >> l & 1) || o->state == ENDED) continue;
    if (o->state != WAITS || o->op != f->op || o->site != f->site || o->mask != f->mask) return 0;
    there |= 1u << l;
  }
  if (!(there >> (t - first) & 1)) { fprintf(stderr, "emulator: %s: thread %u of block %u is not in its own mask %08x\n", b->fn->name, t, f->w.ctaid, f->mask); abort(); }
  uint32_t ballot = 0;
  for (uint32_t l = 0; l < warp_n; l++) if (there >> l & 1 && b->f[first + l].value) ballot |= 1u << l;
  for (uint32_t l = 0; l < warp_n; l++) {
    if (!(there >> l & 1)) continue;
    Fiber *o = &b->f[first + l]; uint32_t r = 0; int ok = 1;
    int low = ((o->clamp >> 8) & 31) & l, c = o->clamp & 31, seg = (c & ~((o->clamp >> 8) & 31)) | low, j = l, a = o->arg & 31;
    switch (o->op) {
      case BALLOT: r = ballot; break;
      case ALL: r = ballot == there; break;
      case ANY: r = ballot != 0; break;
      case UNI: r = ballot == there || !ballot; break;
      case MATCH_ANY: case MATCH_ALL:
        for (uint32_t m = 0; m < warp_n; m++) if (there >> m & 1 && b->f[first + m].value == o->value) r |= 1u << m;
        if (o->op == MATCH_ALL) { ok = r == there; r = ok ? r : 0; } break;
      case IDX: j = low | (a & ~((o->clamp >> 8) & 31)); ok = j <= seg; break;
      case UP: j = (int)l - a; ok = j >= (c | low); break;
      case DOWN: j = l + a; ok = j <= seg; break;
      case BFLY: j = l ^ a; ok = j <= seg; break;
    }
    if (o->op >= IDX && o->op <= BFLY) {
      if (!ok) j = l;
      r = there >> j & 1 ? b->f[first + j].value : 0xBADC0DE5u;  // from a lane that does not take part: undefined
    }
    o->result = r; if (o->pred) *o->pred = ok;
  }
  for (uint32_t l = 0; l < warp_n; l++) if (there >> l & 1) b->f[first + l].state = RUNS;
  if (counting) fold(b, first, there);
  b->warp_epoch[first / 32]++;
  return 1;
}
// Races (-DTOUCH): two threads of a block, one of which writes, at the same word with no barrier between them.
typedef struct { uint64_t word; uint32_t launch_block, epoch, we; uint16_t writer, reader; uint32_t r_epoch, r_we; uint8_t atomic, many; } Shadow;
static __thread Shadow *shadow; static __thread uint64_t block_number; static long n_races;
static void race(Where *w, Shadow *s, const char *what, uint32_t other) {
  if (__sync_fetch_and_add(&n_races, 1) < 20) fprintf(stderr, "emulator: race in %s, block %u: thread %u %s a word at %lx that thread %u %s in the same interval\n", block->fn->name, w->ctaid, w->tid, what, (unsigned long)s->word << 1, other, what[0] == 'r' ? "wrote" : "used");
}
static void race_touch(Where *w, uint64_t a, int n, int kind) {
  char here; if (a > (uint64_t)&here - 4096 && a < (uint64_t)&here + STACK) return;  // its own stack
  kind &= 3;
  if (!shadow) shadow = calloc(1u << 22, sizeof(Shadow));
  uint32_t we = block->warp_epoch[w->tid / 32], me = w->tid;
  for (uint64_t word = a >> 1; word <= (a + n - 1) >> 1; word++) {  // of two bytes: the least that kernels have
    Shadow *s = &shadow[(word * 11400714819323198485ull) >> 42];
    if (s->word != word || s->launch_block != (uint32_t)block_number) { memset(s, 0, sizeof *s); s->word = word; s->launch_block = block_number; s->writer = s->reader = 0xFFFF; }
#define CLASH(t, e, x) (t != 0xFFFF && t != me && e == block->epoch && (t / 32 != me / 32 || x == we))
    if (CLASH(s->writer, s->epoch, s->we) && !(kind == 2 && s->atomic)) race(w, s, kind ? "writes" : "reads", s->writer);
    if (kind && CLASH(s->reader, s->r_epoch, s->r_we)) race(w, s, "writes", s->reader);
    if (kind) { s->writer = me; s->epoch = block->epoch; s->we = we; s->atomic = kind == 2; }
    else if (s->reader == 0xFFFF || s->r_epoch != block->epoch || s->reader == me || s->r_we != we) { s->reader = me; s->r_epoch = block->epoch; s->r_we = we; }
  }
}
__attribute__((destructor)) static void tell_warps(void) {
  if (n_races) fprintf(stderr, "emulator: %ld races\n", n_races);
  if (!n_warps) return; char p[600]; snprintf(p, 600, "%s/warps.txt", dir()); FILE *f = fopen(p, "w");
  fprintf(f, "# kernel launches blocks crit(cycles a block, dependent chain) overlapped(the same, where independent instructions of a basic block do not wait for each other, and loads come from the L2) issue(warp instructions a block) | by class, warp instructions a block (lanes busy of 32): int f64 div lds sts ldg stg atoms atomg meet branch\n");
  for (int i = 0; i < n_warps; i++) if (warps[i].blocks > 0) {
    double b = warps[i].blocks, issue = 0; for (int e = 0; e < CLASSES; e++) issue += warps[i].warp[e] * issue_of[e];
    fprintf(f, "%s %.0f %.0f %.0f %.0f %.0f |", warps[i].name, warps[i].launches, b, warps[i].crit / b, warps[i].over / b, issue / b);
    for (int e = 0; e < CLASSES; e++) fprintf(f, " %.0f(%.1f)", warps[i].warp[e] / b, warps[i].thread[e] / (warps[i].warp[e] > 0 ? warps[i].warp[e] : 1));
    fprintf(f, "\n");
  }
  fclose(f);
}
static uint32_t at_turn(uint64_t k, uint32_t n, long order, uint64_t turn) {  // the k-th of n in this order
  if (order == 0) return k; if (order == 1) return n - 1 - k;
  uint32_t step = 2654435761u % n, a, c; for (;; step++) { for (a = step, c = n; c;) { uint32_t r = a % c; a = c; c = r; } if (a == 1) break; }
  return (k * step + (uint64_t)order * 97 + turn * 7919) % n;
}
static void run_block(Block *b, uint32_t ctaid, uint32_t g, long order) {
  block = b; b->fn->poison(); memset(b->warp_epoch, 0, sizeof b->warp_epoch); b->epoch = 0; block_number++;
  for (uint32_t i = 0; i < b->n; i++) {
    Fiber *f = &b->f[i]; f->w = (Where){ctaid, i, g, b->n, meet, touching ? count_touch : race_touch, f->visits}; f->state = RUNS; fiber_new(f);
    if (counting) memset(f->visits, 0, 4 * b->fn->blocks);
  }
  if (counting) { pthread_mutex_lock(&warp_lock); warps[warp_now].blocks++; }
  for (uint64_t turn = 0, left = b->n; left;) {
    uint32_t ran = 0; turn++;
    for (uint32_t k = 0; k < b->n; k++) {
      Fiber *f = &b->f[at_turn(k, b->n, order, turn)];
      if (f->state != RUNS) continue;
      b->now = f; ran++; stub_switch(&b->sp, f->sp);
      if (f->state == ENDED) left--;
    }
    // Who waits may go on: looked for when all have come as far as they can, so that an end of a thread counts too.
    for (uint32_t k = 0; k < b->n; k++) if (b->f[k].state == WAITS) ran += complete(b, &b->f[k]);
    if (!ran && left) {
      fprintf(stderr, "emulator: %s, block %u: its threads wait for each other for ever:\n", b->fn->name, ctaid);
      for (uint32_t k = 0; k < b->n; k++) if (!k || b->f[k].state != b->f[k - 1].state || b->f[k].site != b->f[k - 1].site)
        fprintf(stderr, "  from thread %u on: %s\n", k, b->f[k].state == ENDED ? "ended" : op_names[b->f[k].op]), b->f[k].state == WAITS ? fprintf(stderr, "    at meeting point %d of the C code, mask %08x\n", b->f[k].site, b->f[k].mask) : 0;
      abort();
    }
  }
  if (counting) { for (uint32_t k = 0; k < b->n; k += 32) fold(b, k, ~0u); end_interval(b); pthread_mutex_unlock(&warp_lock); }
}
typedef struct { Func *f; void **p; uint32_t g, b, lo, hi; uint32_t *perm; } Job;
#include <sys/mman.h>
static void *work_blocks(void *v) {
  Job *j = v; Block b = {0}; b.n = j->b; b.fn = j->f; b.args = j->p; b.f = calloc(j->b, sizeof(Fiber));
  static __thread char *stacks; if (!stacks) stacks = mmap(0, (size_t)STACK * 1024, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  for (uint32_t i = 0; i < b.n; i++) { b.f[i].stack = stacks + (size_t)STACK * i; b.f[i].visits = counting ? calloc(j->f->blocks, 4) : 0; }
  long order = geti("STUB_ORDER", 0);
  for (uint32_t k = j->lo; k < j->hi; k++) run_block(&b, at_turn(k, j->g, order, 0), j->g, order);
  for (uint32_t i = 0; i < b.n; i++) free(b.f[i].visits);
  free(b.f); block = 0; return 0;
}
static void *work(void *v) {
  Job *j = v; Where w = {0}; w.nctaid = j->g; w.ntid = j->b;
  long order = geti("STUB_ORDER", 0);
  uint32_t total = j->g * j->b;
  for (uint64_t k = j->lo; k < j->hi; k++) {
    uint32_t t = order == 0 ? k : order == 1 ? total - 1 - k : (uint32_t)((k * 2654435761ull + (uint64_t)order * 97) % total);
    w.ctaid = t / j->b; w.tid = t % j->b; j->f->fn(j->p, &w);
  }
  return 0;
}
static uint32_t gcd(uint32_t a, uint32_t b) { while (b) { uint32_t t = a % b; a = b; b = t; } return a; }
int cuLaunchKernel(Func *f, unsigned gx, unsigned gy, unsigned gz, unsigned bx, unsigned by, unsigned bz, unsigned sh, void *st, void **p, void **extra) {
  n_launch++;
  if (geti("STUB_LOG", 1)) fprintf(lg(), "LAUNCH m%d %s <<<%u,%u,%u>>>\n", f->m->id, f->name, gx, bx, sh);
  if (f->fn) {
    long T = geti("STUB_THREADS", 1);
    counting = geti("STUB_WARP", 0); racing = geti("STUB_RACE", 0); touching = geti("STUB_COUNT", 0);
    if (f->meets || counting || racing || touching) {
      if (touching) {
        if (!tags) tags = calloc(1u << 28, 4);
        int i; for (i = 0; i < n_counts && strcmp(counts[i].name, f->name); i++);
        if (i == n_counts) snprintf(counts[n_counts++].name, 256, "%s", f->name);
        now_c = &counts[i]; now_c->launches++; tag_now++;
      }
      if (counting) {
        for (warp_now = 0; warp_now < n_warps && strcmp(warps[warp_now].name, f->name); warp_now++);
        if (warp_now == n_warps) snprintf(warps[n_warps++].name, 256, "%s", f->name);
        warps[warp_now].launches++;
      }
      if (T > (long)gx || T < 1 || counting || touching) T = 1;
      if (T > 64) T = 64;
      Job j[64]; pthread_t th[64];
      for (int i = 0; i < T; i++) { j[i] = (Job){f, p, gx, bx, (uint64_t)gx * i / T, (uint64_t)gx * (i + 1) / T, 0}; if (i) pthread_create(&th[i], 0, work_blocks, &j[i]); }
      work_blocks(&j[0]);
      for (int i = 1; i < T; i++) pthread_join(th[i], 0);
      return 0;
    }
    uint32_t total = gx * bx;
    if (T > total || total < 256) T = 1;
    Job j[64]; pthread_t th[64];
    if (T > 64) T = 64;
    for (int i = 0; i < T; i++) { j[i] = (Job){f, p, gx, bx, (uint64_t)total * i / T, (uint64_t)total * (i + 1) / T, 0}; if (i) pthread_create(&th[i], 0, work, &j[i]); }
    work(&j[0]);
    for (int i = 1; i < T; i++) pthread_join(th[i], 0);
  }
  return 0;
}
