typedef struct Where Where;
struct Where {
  uint32_t ctaid, tid, nctaid, ntid;
  uint32_t (*meet)(Where *, int op, int site, uint32_t mask, uint32_t value, uint32_t arg, uint32_t clamp, uint8_t *pred);
  void (*touch)(Where *, uint64_t address, int bytes, int kind);
  uint32_t *visits;
};
enum { BAR, BAR_POPC, BAR_AND, BAR_OR, WARP_BAR, BALLOT, ALL, ANY, UNI, IDX, UP, DOWN, BFLY, MATCH_ANY, MATCH_ALL };
